//! Where plugins' events arrive. Each belongs into a callback of the instance whose port it is, as those of a query.

use component_sdk::abi::calls::{Lent, Wait, Whose};
use component_sdk::abi::events::{EventApi, Mode, Testing, Which};
use component_sdk::abi::payload::PortHandle;
use component_sdk::status::Status;

use super::border::{End, visit};
use super::pattern::event_client::EventClient;
use super::pattern::event_server::EventServer;
use super::wait;

/// What every plugin is given for its events.
pub(super) const API: EventApi = EventApi { loan, activate, deactivate, state, fetch, blocking, first, next, leave };

/// Calls `act` with the client port of a handle; `idle` is what one of an instance that stands ready answers.
fn client<R>(
    handle: PortHandle,
    idle: Status,
    act: impl FnOnce(&EventClient) -> Result<R, Status>,
) -> Result<R, Status> {
    visit(handle, |end, borrower| match end {
        _ if matches!(end, End::Closed) => Err(Status::Closed),
        _ if !borrower.may_call() => Err(Status::NotAllowed),
        End::EventClient(port) => act(port),
        End::Idle => Err(idle),
        _ => Err(Status::NotAllowed),
    })
}

/// Calls `act` with the server port of a handle.
fn server(handle: PortHandle, act: impl FnOnce(&EventServer) -> Testing) -> Testing {
    visit(handle, |end, borrower| match end {
        _ if matches!(end, End::Closed) => Testing::over(Status::Closed),
        _ if !borrower.may_call() => Testing::over(Status::NotAllowed),
        End::EventServer(port) => act(port),
        // Nobody asks an instance that stands ready.
        End::Idle => Testing::over(Status::NoData),
        _ => Testing::over(Status::NotAllowed),
    })
}

fn lent(result: Result<Lent, Status>) -> Lent {
    result.unwrap_or_else(Lent::refused)
}

fn code(result: Result<(), Status>) -> u32 {
    result.map_or_else(Status::code, |()| 0)
}

extern "C" fn loan(handle: PortHandle) -> Lent {
    lent(client(handle, Status::Disconnected, |port| Ok(port.loan())))
}

extern "C" fn activate(handle: PortHandle, id: u64, mode: Mode) -> u32 {
    code(client(handle, Status::WrongId, |port| port.activate(id, mode)))
}

extern "C" fn deactivate(handle: PortHandle, id: u64) -> u32 {
    code(client(handle, Status::WrongId, |port| port.deactivate(id)))
}

extern "C" fn state(handle: PortHandle, id: u64) -> u32 {
    code(client(handle, Status::WrongId, |port| port.state(id)))
}

extern "C" fn fetch(handle: PortHandle, id: u64, which: Which, time: Wait) -> Lent {
    lent(client(handle, Status::WrongId, |port| Ok(port.fetch(id, which, time, &wait::park))))
}

extern "C" fn blocking(handle: PortHandle, whose: Whose, on: bool) -> u32 {
    code(client(handle, Status::Disconnected, |port| {
        port.blocking(whose, on);
        Ok(())
    }))
}

extern "C" fn first(handle: PortHandle) -> Testing {
    server(handle, EventServer::first)
}

extern "C" fn next(handle: PortHandle, id: u64, fires: bool) -> Testing {
    server(handle, |port| port.next(id, fires))
}

extern "C" fn leave(handle: PortHandle, id: u64) {
    let _ = server(handle, |port| {
        port.leave_test(id);
        Testing::over(Status::NoData)
    });
}
