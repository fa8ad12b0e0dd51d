//! Interleavings of both ends of a call: it ends once, whoever is faster, whoever waits is woken, and its memory is used
//! again when both have let go.
#![allow(unsafe_code, reason = "the test plays the plugins, which write and read through the pointers")]

use std::sync::Arc;

use component_sdk::abi::calls::{Lent, Wait};
use component_sdk::object::CommObject;
use component_sdk::status::Status;
use loom::cell::UnsafeCell;
use loom::model::Builder;
use loom::thread;
use loom_tests::bell::Signal;
use loom_tests::port::pattern::objects::Objects;
use loom_tests::port::pattern::provider::{Openness, Provider};
use loom_tests::port::pattern::requestor::{Requestor, Room};
use loom_tests::port::wait::{NotHere, Place, Waiter};

/// All interleavings with up to that many involuntary switches, instead of all.
fn bounded(switches: usize, model: impl Fn() + Send + Sync + 'static) {
    let mut builder = Builder::new();
    builder.preemption_bound = Some(switches);
    builder.check(model);
}

/// A client with one call and its server.
struct Ends {
    client: Arc<Requestor>,
    server: Arc<Provider>,
    rung: Arc<Signal>,
}

impl Ends {
    fn new(retry: bool) -> Self {
        let objects = Objects { request: u64::DESCRIPTOR, answer: Some(u64::DESCRIPTOR) };
        let room = Room { pending: 1, timeout_ns: 1_000, retry };
        let client = Arc::new(Requestor::new("asks", objects, room, Waiter::new()));
        let server = Arc::new(Provider::new("tells", objects, 2, Waiter::new()));
        let rung = Arc::new(Signal::default());
        client.listen(Arc::clone(&rung));
        server.set_open(Openness::Serving);
        client.connect(&server, None).unwrap();
        Self { client, server, rung }
    }

    /// Asks; the number of the call.
    fn asked(&self, number: u64) -> u64 {
        let id = ask(&self.client, number).expect("it is open");
        assert_ne!(id, 0);
        id
    }

    /// Waits for the end of a call: a ring that is missing is a deadlock.
    fn end(&self, id: u64) -> Result<u64, Status> {
        receive(&self.client, id, Wait::DEFAULT, &Rung(&self.rung))
    }

    /// The call is over, and free once more.
    fn settled(&self, id: u64) {
        assert_eq!(receive(&self.client, id, Wait::NONE, &Nowhere), Err(Status::WrongId), "one end");
        self.server.set_open(Openness::Stopped);
        assert_eq!(self.client.loan().status, 0, "both have let go");
    }
}

fn write(value: *mut u8, number: u64) {
    // SAFETY: the block of the checker is such a cell; it reports whoever else touches it.
    unsafe { (*value.cast::<UnsafeCell<u64>>()).with_mut(|place| *place = number) };
}

fn read(value: *const u8) -> u64 {
    // SAFETY: as above.
    unsafe { (*value.cast::<UnsafeCell<u64>>()).with(|place| *place) }
}

fn ask(client: &Requestor, number: u64) -> Result<u64, Status> {
    let lent = client.loan();
    if lent.status != 0 {
        return Err(Status::from_code(lent.status));
    }
    write(lent.value, number);
    client.send(lent.id).map(|()| lent.id)
}

fn receive(client: &Requestor, id: u64, wait: Wait, place: &impl Place) -> Result<u64, Status> {
    let lent: Lent = client.receive(id, wait, place);
    if lent.status != 0 {
        return Err(Status::from_code(lent.status));
    }
    let answer = read(lent.value);
    client.release(id);
    Ok(answer)
}

/// Serves what is there; the answer is the request and one.
fn serve(server: &Provider) -> Option<Result<(), Status>> {
    let call = server.next()?;
    let number = read(call.value);
    let lent = server.answer_loan(call.id);
    assert_eq!(lent.status, 0, "it is in hand");
    write(lent.value, number + 1);
    Some(server.answer(call.id))
}

struct Rung<'a>(&'a Signal);

impl Place for Rung<'_> {
    fn now_ns(&self) -> u64 {
        0
    }

    fn park(&self, _: u64) -> Result<(), NotHere> {
        self.0.wait();
        Ok(())
    }
}

struct Nowhere;

impl Place for Nowhere {
    fn now_ns(&self) -> u64 {
        0
    }

    fn park(&self, _: u64) -> Result<(), NotHere> {
        Err(NotHere)
    }
}

fn beside(act: impl FnOnce() + 'static) -> thread::JoinHandle<()> {
    thread::spawn(act)
}

#[test]
fn an_answer_is_seen_whole_by_whoever_waits() {
    bounded(3, || {
        let ends = Ends::new(false);
        let id = ends.asked(5);
        let server = Arc::clone(&ends.server);
        let serves = beside(move || assert_eq!(serve(&server), Some(Ok(()))));
        assert_eq!(ends.end(id), Ok(6));
        serves.join().unwrap();
        ends.settled(id);
    });
}

#[test]
fn an_answer_beside_a_disconnection_is_the_one_or_the_other() {
    bounded(2, || {
        let ends = Ends::new(false);
        let id = ends.asked(5);
        let (server, client) = (Arc::clone(&ends.server), Arc::clone(&ends.client));
        // Before it was taken in hand it is only put aside.
        let serves = beside(move || _ = serve(&server));
        let cuts = beside(move || client.disconnect());
        let end = ends.end(id);
        assert!(end == Ok(6) || end == Err(Status::Disconnected), "{end:?}");
        serves.join().unwrap();
        cuts.join().unwrap();
        ends.settled(id);
    });
}

#[test]
fn a_discarded_call_is_used_again_when_the_server_has_let_go() {
    bounded(3, || {
        let ends = Ends::new(false);
        let id = ends.asked(5);
        let server = Arc::clone(&ends.server);
        let serves = beside(move || {
            serve(&server);
            serve(&server);
        });
        assert_eq!(ends.client.discard(id), Ok(()));
        let again = ask(&ends.client, 7);
        assert!(matches!(again, Ok(_) | Err(Status::Overload)), "{again:?}");
        serves.join().unwrap();
        if let Ok(again) = again {
            serve(&ends.server);
            assert_eq!(ends.end(again), Ok(8), "not the answer to the one before");
        }
        ends.settled(id);
    });
}

#[test]
fn a_call_that_comes_while_the_server_closes_is_refused_or_ended() {
    for open in [Openness::Stopped, Openness::Gone] {
        bounded(3, move || {
            let ends = Ends::new(false);
            let server = Arc::clone(&ends.server);
            let closes = beside(move || server.set_open(open));
            if let Ok(id) = ask(&ends.client, 5) {
                let end = ends.end(id);
                assert!(matches!(end, Err(Status::ProviderStopped | Status::ProviderGone)), "{end:?}");
            }
            closes.join().unwrap();
            ends.settled(0);
        });
    }
}

#[test]
fn a_call_that_comes_while_the_server_is_replaced_is_refused_ended_or_served() {
    bounded(2, || {
        let ends = Ends::new(false);
        let (server, operator) = (Arc::clone(&ends.server), Arc::clone(&ends.server));
        let runs = beside(move || {
            serve(&server);
            server.set_open(Openness::Stopped);
        });
        let replaces = beside(move || operator.replace());
        if let Ok(id) = ask(&ends.client, 5) {
            let end = ends.end(id);
            assert!(matches!(end, Ok(6) | Err(Status::ProviderStopped | Status::ProviderReplaced)), "{end:?}");
        }
        runs.join().unwrap();
        replaces.join().unwrap();
        assert_eq!(ask(&ends.client, 5), Err(Status::ProviderReplaced), "it stays so");
        ends.settled(0);
    });
}

#[test]
fn a_failed_server_lets_go_beside_a_client_that_does() {
    bounded(2, || {
        let ends = Ends::new(false);
        let id = ends.asked(5);
        let (server, client) = (Arc::clone(&ends.server), Arc::clone(&ends.client));
        let fails = beside(move || {
            if let Some(call) = server.next() {
                write(server.answer_loan(call.id).value, 99);
            }
            server.fail();
        });
        let cuts = beside(move || client.disconnect());
        let end = ends.end(id);
        assert!(matches!(end, Err(Status::ProviderGone | Status::Disconnected)), "{end:?}");
        fails.join().unwrap();
        cuts.join().unwrap();
        ends.settled(id);
    });
}

#[test]
fn a_call_that_is_asked_again_has_one_end_beside_a_disconnection() {
    bounded(2, || {
        let ends = Ends::new(true);
        let id = ends.asked(5);
        let (server, client) = (Arc::clone(&ends.server), Arc::clone(&ends.client));
        let fails = beside(move || {
            let _ = server.next();
            server.fail();
            serve(&server);
        });
        let cuts = beside(move || client.disconnect());
        let end = ends.end(id);
        // It was in the hand of a server that failed, and its client had left.
        assert!(matches!(end, Ok(6) | Err(Status::Disconnected | Status::ProviderGone)), "{end:?}");
        fails.join().unwrap();
        cuts.join().unwrap();
        ends.settled(id);
    });
}

#[test]
fn a_client_that_fails_leaves_its_calls_and_its_successor_uses_them() {
    bounded(3, || {
        let ends = Ends::new(false);
        let _ = ends.asked(5);
        let server = Arc::clone(&ends.server);
        let serves = beside(move || _ = serve(&server));
        ends.client.close_calls();
        let again = ask(&ends.client, 7);
        serves.join().unwrap();
        if let Ok(again) = again {
            serve(&ends.server);
            assert_eq!(ends.end(again), Ok(8));
        }
        ends.settled(0);
    });
}
