//! Where plugins' subscriptions, waits for the next value, and cycles arrive. They belong into a callback of the instance
//! whose port it is, or into a task that the port was moved into, as queries do.

use component_sdk::abi::calls::{Wait, Whose};
use component_sdk::abi::payload::PortHandle;
use component_sdk::abi::push::{PushApi, PushInfo, Update};
use component_sdk::status::Status;

use super::border::{End, visit, visit_beside};
use super::input::InPort;
use super::output::{Borrower, OutPort};
use super::pattern::subscriber::Subscriber;
use super::wait;
use crate::sys::seat;

/// What every plugin is given for its push ports.
pub(super) const API: PushApi = PushApi { subscribe, unsubscribe, update, info, blocking, start, stop };

/// Calls `act` with the input of a handle.
fn input<R>(handle: PortHandle, act: impl FnOnce(&InPort, Borrower) -> Result<R, Status>) -> Result<R, Status> {
    visit(handle, |end, borrower| match end {
        _ if matches!(end, End::Closed) => Err(Status::Closed),
        _ if !borrower.may_call() => Err(Status::NotAllowed),
        End::In(port) => act(port, borrower),
        // An instance that stands ready is not connected.
        End::Nowhere => Err(Status::Disconnected),
        _ => Err(Status::NotAllowed),
    })
}

/// Calls `act` with the push client of a handle.
fn client<R>(handle: PortHandle, act: impl FnOnce(&Subscriber) -> Result<R, Status>) -> Result<R, Status> {
    input(handle, |port, _| port.subscriber().ok_or(Status::NotAllowed).and_then(act))
}

/// Calls `act` with the output of a handle.
fn server<R>(handle: PortHandle, act: impl FnOnce(&OutPort) -> Result<R, Status>) -> Result<R, Status> {
    visit(handle, |end, borrower| match end {
        _ if matches!(end, End::Closed) => Err(Status::Closed),
        _ if !borrower.may_call() => Err(Status::NotAllowed),
        End::Out(port) => act(port),
        End::Scratch(_) => Err(Status::Disconnected),
        _ => Err(Status::NotAllowed),
    })
}

fn code(result: Result<(), Status>) -> u32 {
    result.map_or_else(Status::code, |()| 0)
}

extern "C" fn subscribe(handle: PortHandle, prescale: u32) -> u32 {
    code(client(handle, |port| port.subscribe(prescale)))
}

extern "C" fn unsubscribe(handle: PortHandle) -> u32 {
    code(input(handle, |port, _| {
        port.unsubscribe();
        port.subscriber().map(|_| ()).ok_or(Status::NotAllowed)
    }))
}

extern "C" fn update(handle: PortHandle, time: Wait) -> Update {
    let read = input(handle, |port, borrower| port.update(time, borrower, &wait::park));
    read.map_or_else(Update::refused, |read| Update { value: read.value, stamp_ns: read.stamp_ns, status: 0 })
}

extern "C" fn info(handle: PortHandle) -> PushInfo {
    client(handle, Subscriber::info).unwrap_or_else(PushInfo::refused)
}

extern "C" fn blocking(handle: PortHandle, whose: Whose, on: bool) -> u32 {
    if whose == Whose::Component && seat::task().is_some() {
        // A task speaks for the whole component here, and takes no port.
        return code(visit_beside(handle, |end| match end {
            End::Closed => Err(Status::Closed),
            End::In(port) => {
                port.subscriber().ok_or(Status::NotAllowed)?.blocking(whose, on);
                Ok(())
            }
            _ => Err(Status::NotAllowed),
        }));
    }
    code(client(handle, |port| {
        port.blocking(whose, on);
        Ok(())
    }))
}

extern "C" fn start(handle: PortHandle) -> u32 {
    code(server(handle, OutPort::start))
}

extern "C" fn stop(handle: PortHandle) -> u32 {
    code(server(handle, OutPort::stop))
}
