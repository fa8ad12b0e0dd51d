//! What is locked while somebody is in the middle of something: nothing. In the middle of a test of events, of an answer and of
//! a put another thread goes through everything that others do; held up, it would not come back. And the one lock that is held
//! meanwhile, a reader's own while it is wired, is told of and not waited out.
#![cfg(test)]
#![allow(unsafe_code, reason = "the test plays the plugins, which write through the pointers")]

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use component_sdk::abi::calls::Lent;
use component_sdk::abi::events::Mode;
use component_sdk::object::CommObject;
use component_sdk::port::Sent;
use component_sdk::status::Status;

use super::event_client::{self, EventClient};
use super::event_server::EventServer;
use super::objects::Objects;
use super::provider::{Openness, Provider};
use super::requestor::{Requestor, Room};
use crate::port::border::PortEnd;
use crate::port::check::Checks;
use crate::port::input::InPort;
use crate::port::output::{Borrower, OutPort};
use crate::port::registry::{Entry, Registry};
use crate::port::tap::{Heard, Tap};
use crate::port::wait::Waiter;
use crate::port::wiring::{self, Name};
use crate::profile::plan::{Overflow, Queue};

const QUERY: Objects = Objects { request: u64::DESCRIPTOR, answer: Some(u64::DESCRIPTOR) };
/// Beyond any load: whoever is held up is held up for ever.
const PATIENCE: Duration = Duration::from_secs(120);

/// Another thread does that, and comes back.
fn goes_on(what: &str, others: impl FnOnce() + Send + 'static) {
    let (other, began) = (thread::spawn(others), Instant::now());
    while !other.is_finished() {
        assert!(began.elapsed() < PATIENCE, "held up: {what}");
        thread::sleep(Duration::from_millis(1));
    }
    other.join().unwrap();
}

fn fill(lent: &Lent, value: u64) -> u64 {
    assert_eq!(lent.status, 0);
    // SAFETY: lent for a `u64`, to this borrower.
    unsafe { lent.value.cast::<u64>().write(value) };
    lent.id
}

fn listener() -> Arc<EventClient> {
    let (activations, queue, overflow, handled) = (2, 1, Overflow::DropOldest, true);
    let room = event_client::Room { activations, queue, overflow, handled, timeout_ns: 1_000 };
    Arc::new(EventClient::new("level", u64::DESCRIPTOR, u64::DESCRIPTOR, room, Waiter::new()))
}

fn activate(client: &EventClient) -> u64 {
    let id = fill(&client.loan(), 5);
    client.activate(id, Mode::Continuous).unwrap();
    id
}

/// In the middle of a test of its activation.
fn in_a_put_of_events() {
    let server = Arc::new(EventServer::new("levels", u64::DESCRIPTOR, u64::DESCRIPTOR, false, Waiter::new()));
    let clients = [listener(), listener()];
    server.set_open(Openness::Serving);
    clients.iter().for_each(|client| client.connect(&server).unwrap());
    let ids = [activate(&clients[0]), activate(&clients[1])];
    let testing = server.first();
    assert_eq!(testing.status, 0);
    let (others, end) = (clients.clone(), Arc::clone(&server));
    goes_on("events", move || {
        others[0].deactivate(ids[0]).unwrap();
        activate(&others[0]);
        others[1].disconnect();
        others[1].connect(&end).unwrap();
        activate(&others[1]);
        assert_eq!(end.counts().0, 2);
        end.set_open(Openness::Stopped);
        end.set_open(Openness::Serving);
    });
    server.leave_test(testing.id);
}

fn requestor() -> Arc<Requestor> {
    let room = Room { pending: 2, timeout_ns: 1_000, retry: false };
    Arc::new(Requestor::new("scan", QUERY, room, Waiter::new()))
}

/// In the middle of an answer.
fn in_an_answer() {
    let (server, clients) = (Arc::new(Provider::new("scans", QUERY, 2, Waiter::new())), [requestor(), requestor()]);
    server.set_open(Openness::Serving);
    clients.iter().for_each(|client| client.connect(&server, None).unwrap());
    clients[0].send(fill(&clients[0].loan(), 1)).unwrap();
    let held = server.next().map(|args| args.id).unwrap();
    fill(&server.answer_loan(held), 2);
    let (others, end) = (clients.clone(), Arc::clone(&server));
    goes_on("queries", move || {
        others[1].send(fill(&others[1].loan(), 3)).unwrap();
        others[1].disconnect();
        others[1].connect(&end, None).unwrap();
        others[1].send(fill(&others[1].loan(), 4)).unwrap();
        others[0].blocking(component_sdk::abi::calls::Whose::Component, false);
        assert_eq!(end.counts().0, 2);
    });
    assert_eq!(server.answer(held), Ok(()));
}

const WRITES: Name<'static> = Name { slot: "writer", port: "out" };
const READS: [Name<'static>; 2] = [Name { slot: "one", port: "in" }, Name { slot: "two", port: "in" }];

struct Wired {
    registry: Registry,
    output: Arc<OutPort>,
    inputs: Vec<Arc<InPort>>,
}

fn wired() -> Arc<Wired> {
    let input = |_| Arc::new(InPort::new("in", u64::DESCRIPTOR, Queue::Last, Checks::default()));
    let (output, inputs) = (Arc::new(OutPort::new("out", u64::DESCRIPTOR, Checks::default())), [(); 2].map(input));
    let ends = [
        ("writer", PortEnd::Out(Arc::clone(&output))),
        ("one", PortEnd::In(Arc::clone(&inputs[0]))),
        ("two", PortEnd::In(Arc::clone(&inputs[1]))),
    ];
    let registry = Registry::default();
    registry.set(ends.map(|(slot, end)| Entry { slot, end, is_listed: true }).into()).unwrap();
    wiring::connect(&registry, WRITES, READS[0]).unwrap();
    Arc::new(Wired { registry, output, inputs: inputs.into() })
}

/// Hears a value in the middle of its put.
struct Middle {
    wired: Arc<Wired>,
    heard: AtomicU64,
}

impl Tap for Middle {
    fn name(&self) -> &'static str {
        "middle"
    }

    fn heard(&self, _: &Heard<'_>) {
        let wired = Arc::clone(&self.wired);
        goes_on("values", move || {
            wiring::connect(&wired.registry, READS[1], WRITES).unwrap();
            wiring::disconnect(&wired.registry, READS[0]).unwrap();
            wiring::connect(&wired.registry, READS[0], WRITES).unwrap();
            assert_eq!((wired.output.links().len(), wired.inputs[1].counts().0), (2, 0));
        });
        self.heard.fetch_add(1, Ordering::Relaxed);
    }
}

/// In the middle of a put of a value.
fn in_a_put_of_values() {
    let wired = wired();
    let middle = Arc::new(Middle { wired: Arc::clone(&wired), heard: AtomicU64::new(0) });
    wired.output.listen(vec![Arc::clone(&middle) as Arc<dyn Tap>]).unwrap();
    let lent = wired.output.loan(Borrower::Callback);
    // SAFETY: the block on loan is for one u64.
    unsafe { lent.value.cast::<u64>().write(7) };
    assert_eq!(wired.output.publish(lent.value, Borrower::Callback), Sent::Ok);
    assert_eq!(middle.heard.load(Ordering::Relaxed), 1);
}

#[test]
fn no_lock_is_held_over_put_or_answer() {
    in_a_put_of_events();
    in_an_answer();
    in_a_put_of_values();
}

#[test]
fn connect_error() {
    let wired = wired();
    let somebody = wired.inputs[0].sources().unwrap();
    let refusal = wiring::connect(&wired.registry, READS[0], WRITES).unwrap_err();
    assert_eq!(refusal.cause, Status::Error);
    assert!(refusal.reason.as_str().contains("one.in"), "{}", refusal.reason.as_str());
    drop(somebody);
    wiring::connect(&wired.registry, READS[0], WRITES).unwrap();
}
