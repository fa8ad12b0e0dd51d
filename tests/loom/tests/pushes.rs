//! Interleavings of a wait for the next value with all that may end it: no ring is missing, and what ends it is what came
//! first, or what came with it.

use component_sdk::abi::calls::Whose;
use component_sdk::status::Status;
use loom::model::Builder;
use loom::sync::Arc;
use loom::sync::atomic::{AtomicU32, Ordering};
use loom::thread;
use loom_tests::bell::{Ring, Signal};
use loom_tests::port::gate::Gate;
use loom_tests::port::pattern::news::News;
use loom_tests::port::wait::{NotHere, Place};

/// A client, and the newest value that came to it.
#[derive(Default)]
struct Client {
    news: News,
    gate: Gate,
    rung: Signal,
    value: AtomicU32,
}

impl Client {
    fn put(&self, value: u32) {
        self.value.store(value, Ordering::Release);
        if self.news.arrived() {
            self.rung.ring(Ring::Wait);
        }
    }

    fn end(&self, status: Status) {
        self.news.end(status);
        self.rung.ring(Ring::Wait);
    }

    fn close(&self) {
        self.gate.set_author(Whose::Port, false);
        self.rung.ring(Ring::Wait);
    }
}

impl Place for Client {
    fn now_ns(&self) -> u64 {
        0
    }

    fn park(&self, _: u64) -> Result<(), NotHere> {
        self.rung.wait();
        Ok(())
    }
}

/// A wait beside whoever acts on the client, all of which comes after what the wait knows; `judge` is told how it ended: with
/// the value that is there then. A ring that is missing is a deadlock.
fn beside(acts: &'static [fn(&Client)], judge: impl Fn(Result<u32, Status>) -> bool + Send + Sync + 'static) {
    let mut builder = Builder::new();
    // Of the involuntary switches; more of them take minutes and found nothing else.
    builder.preemption_bound = Some(3);
    builder.check(move || {
        let client = Arc::new(Client::default());
        let (known, closings) = (client.news.known(), client.gate.closings());
        let spawned = acts.iter().map(|act| {
            let client = Arc::clone(&client);
            thread::spawn(move || act(&client))
        });
        let others: Vec<_> = spawned.collect();
        let end = client.news.wait(known, &client.gate, closings, 1, &*client);
        let end = end.map(|()| client.value.load(Ordering::Acquire));
        assert!(judge(end), "{end:?}");
        others.into_iter().for_each(|other| other.join().unwrap());
    });
}

#[test]
fn a_value_ends_the_wait_whenever_it_comes_and_is_there() {
    beside(&[|client| client.put(7)], |end| end == Ok(7));
}

#[test]
fn of_two_values_one_is_enough() {
    beside(&[|client| client.put(1), |client| client.put(2)], |end| matches!(end, Ok(1 | 2)));
}

#[test]
fn an_end_is_told_by_its_own_code() {
    beside(&[|client| client.end(Status::Disconnected)], |end| end == Err(Status::Disconnected));
}

#[test]
fn a_value_and_an_end_are_not_mixed_up() {
    beside(&[|client| client.put(7), |client| client.end(Status::Unsubscribed)], |end| {
        matches!(end, Ok(7) | Err(Status::Unsubscribed))
    });
}

#[test]
fn of_two_ends_one_is_told() {
    beside(&[|client| client.end(Status::Disconnected), |client| client.end(Status::NotActivated)], |end| {
        matches!(end, Err(Status::Disconnected | Status::NotActivated))
    });
}

#[test]
fn a_gate_that_closes_cancels_the_wait_unless_there_is_a_value() {
    beside(&[Client::close], |end| end == Err(Status::Cancelled));
    beside(&[|client| client.put(7), Client::close], |end| matches!(end, Ok(7) | Err(Status::Cancelled)));
}
