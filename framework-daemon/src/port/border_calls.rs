//! Where plugins' queries and messages arrive. A call belongs into a callback of the instance whose port it is, or into a
//! task that the port was moved into: any other thread would have to be told apart from the callback at every step.

use component_sdk::abi::calls::{CallApi, Lent, Wait, Whose};
use component_sdk::abi::payload::PortHandle;
use component_sdk::status::Status;

use super::border::{End, visit, visit_beside};
use super::pattern::provider::Provider;
use super::pattern::requestor::Requestor;
use super::wait;
use crate::sys::seat;

/// What every plugin is given for its queries and messages.
pub(super) const API: CallApi =
    CallApi { loan, send, ask, receive, release, discard, blocking, wake, next, opened, answer_loan, answer, refuse };

/// Calls `act` with the client port of a handle.
fn client<R>(handle: PortHandle, act: impl FnOnce(&Requestor) -> Result<R, Status>) -> Result<R, Status> {
    visit(handle, |end, borrower| match end {
        _ if matches!(end, End::Closed) => Err(Status::Closed),
        _ if !borrower.may_call() => Err(Status::NotAllowed),
        End::Requestor(port) => act(port),
        // An instance that stands ready is not connected.
        End::Idle => Err(Status::Disconnected),
        _ => Err(Status::NotAllowed),
    })
}

/// Calls `act` with the server port of a handle.
fn server<R>(handle: PortHandle, act: impl FnOnce(&Provider) -> Result<R, Status>) -> Result<R, Status> {
    visit(handle, |end, borrower| match end {
        _ if matches!(end, End::Closed) => Err(Status::Closed),
        _ if !borrower.may_call() => Err(Status::NotAllowed),
        End::Provider(port) => act(port),
        End::Idle => Err(Status::WrongId),
        _ => Err(Status::NotAllowed),
    })
}

fn lent(result: Result<Lent, Status>) -> Lent {
    result.unwrap_or_else(Lent::refused)
}

fn code(result: Result<(), Status>) -> u32 {
    result.map_or_else(Status::code, |()| 0)
}

extern "C" fn loan(handle: PortHandle) -> Lent {
    lent(client(handle, |port| Ok(port.loan())))
}

extern "C" fn send(handle: PortHandle, id: u64) -> u32 {
    code(client(handle, |port| port.send(id)))
}

extern "C" fn ask(handle: PortHandle, id: u64, time: Wait) -> Lent {
    lent(client(handle, |port| Ok(port.ask(id, time, &wait::park))))
}

extern "C" fn receive(handle: PortHandle, id: u64, time: Wait) -> Lent {
    lent(client(handle, |port| Ok(port.receive(id, time, &wait::park))))
}

extern "C" fn release(handle: PortHandle, id: u64) {
    // A port that is closed has nothing on loan.
    let _ = client(handle, |port| {
        port.release(id);
        Ok(())
    });
}

extern "C" fn discard(handle: PortHandle, id: u64) -> u32 {
    code(client(handle, |port| port.discard(id)))
}

extern "C" fn blocking(handle: PortHandle, whose: Whose, on: bool) -> u32 {
    if whose == Whose::Component && seat::task().is_some() {
        // A task speaks for the whole component here, and takes no port.
        return code(visit_beside(handle, |end| match end {
            End::Closed => Err(Status::Closed),
            End::Requestor(port) => {
                port.blocking(whose, on);
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

extern "C" fn next(handle: PortHandle, time: Wait) -> Lent {
    let at_rest = |end: &End<'_>| matches!(end, End::Idle);
    if visit(handle, |end, _| at_rest(&end)) {
        // Nothing comes in while the instance stands ready.
        return Lent::refused(Status::NoData);
    }
    lent(server(handle, |port| Ok(port.pull(time, &wait::park))))
}

extern "C" fn wake(handle: PortHandle) -> u32 {
    code(server(handle, |port| {
        port.wake();
        Ok(())
    }))
}

extern "C" fn opened(handle: PortHandle, id: u64) -> Lent {
    lent(server(handle, |port| Ok(port.opened(id))))
}

extern "C" fn answer_loan(handle: PortHandle, id: u64) -> Lent {
    lent(server(handle, |port| Ok(port.answer_loan(id))))
}

extern "C" fn answer(handle: PortHandle, id: u64) -> u32 {
    code(server(handle, |port| port.answer(id)))
}

extern "C" fn refuse(handle: PortHandle, id: u64, status: u32) -> u32 {
    code(server(handle, |port| port.refuse(id, Status::from_code(status))))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use component_sdk::object::CommObject;
    use proptest::prelude::*;

    use super::super::border::{Binding, PortEnd};
    use super::super::pattern::objects::Objects;
    use super::super::pattern::provider::Openness;
    use super::super::pattern::requestor::Room;
    use super::super::wait::Waiter;
    use super::*;
    use crate::sys::seat::{self, Owner};

    const CLOSED: u32 = Status::Closed.code();
    const OBJECTS: Objects = Objects { request: u64::DESCRIPTOR, answer: Some(f64::DESCRIPTOR) };

    fn ends() -> (Arc<Requestor>, Arc<Provider>) {
        let room = Room { pending: 2, timeout_ns: 1_000, retry: false };
        let requestor = Requestor::new("scan", OBJECTS, room, Waiter::new());
        let provider = Provider::new("scans", OBJECTS, 4, Waiter::new());
        provider.set_open(Openness::Serving);
        (Arc::new(requestor), Arc::new(provider))
    }

    fn binding(end: PortEnd, owner: u64) -> Binding {
        Binding::new(end, owner).unwrap()
    }

    fn statuses(handle: PortHandle, id: u64) -> Vec<u32> {
        vec![
            loan(handle).status,
            send(handle, id),
            ask(handle, id, Wait::NONE).status,
            receive(handle, id, Wait::NONE).status,
            discard(handle, id),
            next(handle, Wait::NONE).status,
            opened(handle, id).status,
            answer_loan(handle, id).status,
            answer(handle, id),
            refuse(handle, id, 512),
        ]
    }

    #[test]
    #[allow(unsafe_code, reason = "the test plays both plugins")]
    fn a_request_goes_there_and_its_answer_back_in_the_clients_own_blocks() {
        let (requestor, provider) = ends();
        requestor.connect(&provider, None).unwrap();
        let owner = 0x5eed_0001;
        let asking = binding(PortEnd::Requestor(Arc::clone(&requestor)), owner);
        let answering = binding(PortEnd::Provider(Arc::clone(&provider)), owner);
        assert!(!seat::enter(&Owner { slot: "both", instance: owner }));
        assert_eq!(loan(asking.handle()).status, Status::Disconnected.code(), "at rest");
        asking.open();
        answering.open();
        let request = loan(asking.handle());
        // SAFETY: lent for a `u64`.
        unsafe { request.value.cast::<u64>().write(7) };
        assert_eq!(send(asking.handle(), request.id), 0);
        assert_eq!(receive(asking.handle(), request.id, Wait::NONE).status, Status::NoData.code());
        let served = provider.next().unwrap();
        assert_eq!((served.port, served.value), (answering.handle(), request.value.cast_const()));
        assert_eq!(answer(answering.handle(), served.id), Status::NotAllowed.code(), "nothing is on loan");
        let answered = answer_loan(answering.handle(), served.id);
        // SAFETY: lent for an `f64`.
        unsafe { answered.value.cast::<f64>().write(0.5) };
        assert_eq!(answer(answering.handle(), served.id), 0);
        assert_eq!(answer(answering.handle(), served.id), Status::WrongId.code());
        let got = receive(asking.handle(), request.id, Wait::NONE);
        assert_eq!((got.status, got.value, got.initialised), (0, answered.value, true));
        assert_eq!(receive(asking.handle(), request.id, Wait::NONE).status, Status::WrongId.code());
        release(asking.handle(), request.id);
        asking.close();
        assert!(statuses(asking.handle(), request.id).iter().all(|status| *status == CLOSED));
    }

    #[test]
    fn another_thread_or_a_port_of_another_kind_is_not_allowed() {
        let (requestor, provider) = ends();
        let asking = binding(PortEnd::Requestor(requestor), u64::MAX - 1);
        let answering = binding(PortEnd::Provider(provider), u64::MAX - 1);
        asking.open();
        answering.open();
        let all = statuses(asking.handle(), 1).into_iter().chain(statuses(answering.handle(), 1));
        assert!(all.into_iter().all(|status| status == Status::NotAllowed.code()));
    }

    proptest! {
        #[test]
        fn a_forged_handle_is_a_closed_port(bits: usize, id: u64) {
            let handle = PortHandle(std::ptr::without_provenance(bits));
            prop_assert!(statuses(handle, id).iter().all(|status| *status == CLOSED));
        }
    }
}
