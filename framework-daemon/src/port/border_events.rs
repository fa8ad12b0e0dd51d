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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use component_sdk::object::CommObject;
    use proptest::prelude::*;

    use super::super::border::{Binding, PortEnd};
    use super::super::pattern::event_client::Room;
    use super::super::wait::Waiter;
    use super::*;
    use crate::profile::plan::Overflow;
    use crate::sys::seat::{self, Owner};

    fn ends() -> [PortEnd; 2] {
        let room = Room { activations: 2, queue: 2, overflow: Overflow::Fault, handled: false, timeout_ns: 1_000 };
        let client = Arc::new(EventClient::new("level", u64::DESCRIPTOR, f64::DESCRIPTOR, room, Waiter::new()));
        let server = Arc::new(EventServer::new("levels", u64::DESCRIPTOR, f64::DESCRIPTOR, false, Waiter::new()));
        client.connect(&server).unwrap();
        [PortEnd::EventClient(client), PortEnd::EventServer(server)]
    }

    fn client_statuses(handle: PortHandle, id: u64) -> Vec<u32> {
        vec![
            activate(handle, id, Mode::Single),
            deactivate(handle, id),
            state(handle, id),
            fetch(handle, id, Which::Present, Wait::NONE).status,
            fetch(handle, id, Which::Next, Wait(1)).status,
        ]
    }

    fn statuses(handle: PortHandle, id: u64) -> Vec<u32> {
        let mut all = client_statuses(handle, id);
        leave(handle, id);
        all.extend([loan(handle).status, first(handle).status, next(handle, id, true).status]);
        all
    }

    fn all_are(statuses: &[u32], status: Status) -> bool {
        statuses.iter().all(|found| *found == status.code())
    }

    #[test]
    fn handles_rest_open_and_close_and_numbers_that_nobody_gave_are_wrong() {
        let instance = 0x5eed_0002;
        let [client, server] = ends().map(|end| Binding::new(end, instance).unwrap());
        assert!(!seat::enter(&Owner { slot: "both", instance }));
        assert!(all_are(&client_statuses(client.handle(), 1 << 32), Status::WrongId), "at rest");
        assert_eq!((loan(client.handle()).status, first(server.handle()).status), (11, Status::NoData.code()));
        client.open();
        server.open();
        for id in [0, 1, 1 << 32, u64::MAX, 7 << 32 | 1, u64::from(u32::MAX)] {
            assert!(all_are(&client_statuses(client.handle(), id), Status::WrongId));
            assert_eq!(next(server.handle(), id, true).status, Status::WrongId.code());
            leave(server.handle(), id);
        }
        assert_eq!((loan(server.handle()).status, first(client.handle()).status), (8, 8), "the other side's");
        client.close();
        assert!(all_are(&statuses(client.handle(), 1), Status::Closed));
    }

    #[test]
    fn another_thread_is_not_allowed() {
        for end in ends() {
            let binding = Binding::new(end, u64::MAX >> 2).unwrap();
            binding.open();
            assert!(all_are(&statuses(binding.handle(), 1), Status::NotAllowed));
        }
    }

    proptest! {
        #[test]
        fn a_forged_handle_is_a_closed_port(bits: usize, id: u64) {
            let handle = PortHandle(std::ptr::without_provenance(bits));
            prop_assert!(all_are(&statuses(handle, id), Status::Closed));
        }
    }
}
