//! Everything that may end a wait for the next value, each in the middle of the wait.
#![cfg(test)]

use std::cell::Cell;
use std::sync::Arc;

use component_sdk::abi::calls::{Wait, Whose};
use component_sdk::object::CommObject;
use component_sdk::port::Sent;
use component_sdk::status::Status;

use super::outlet::{Cycle, Outlet};
use super::provider::Openness;
use super::subscriber::{Subscriber, Terms};
use crate::port::border::PortEnd;
use crate::port::check::Checks;
use crate::port::input::InPort;
use crate::port::output::{Borrower, OutPort};
use crate::port::registry::{Entry, Registry};
use crate::port::wait::{NotHere, Place, Waiter};
use crate::port::wiring::{self, Name};
use crate::profile::plan::Queue;

const SERVER: Name<'static> = Name { slot: "server", port: "out" };
const CLIENT: Name<'static> = Name { slot: "client", port: "in" };

/// A timed server that runs, and its client, subscribed to every value.
struct Rig {
    registry: Registry,
    server: Arc<OutPort>,
    client: Arc<InPort>,
    waiters: [Arc<Waiter>; 2],
}

fn rig() -> Rig {
    let waiters = [Waiter::new(), Waiter::new()];
    let cycle = Cycle { period_ns: Some(1), ..Cycle::default() };
    let outlet = Outlet::new(cycle, Arc::clone(&waiters[0]));
    let server = Arc::new(OutPort::serving("out", u64::DESCRIPTOR, Checks::default(), outlet));
    let terms = Terms { prescale: None, timeout_ns: 1_000, handler: Some((2, 4)) };
    let subscriber = Subscriber::new(terms, Arc::clone(&waiters[1]));
    let client = InPort::new("in", u64::DESCRIPTOR, Queue::Last, Checks::default()).subscribed_by(subscriber);
    let client = Arc::new(client);
    let registry = Registry::default();
    let ends = [("server", PortEnd::Out(Arc::clone(&server))), ("client", PortEnd::In(Arc::clone(&client)))];
    registry.set(ends.map(|(slot, end)| Entry { slot, end, is_listed: true }).into()).unwrap();
    let rig = Rig { registry, server, client, waiters };
    rig.connect();
    rig.server.set_open(Openness::Serving);
    rig.server.start().unwrap();
    rig.subscriber().subscribe(1).unwrap();
    rig
}

/// A place where time goes on by one while somebody waits, and something happens.
struct Script<F> {
    now_ns: Cell<u64>,
    event: F,
}

impl<F: Fn()> Place for Script<F> {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    fn park(&self, _until_ns: u64) -> Result<(), NotHere> {
        self.now_ns.set(self.now_ns.get() + 1);
        (self.event)();
        Ok(())
    }
}

impl Rig {
    fn connect(&self) {
        wiring::connect(&self.registry, SERVER, CLIENT).unwrap();
    }

    fn subscriber(&self) -> &Subscriber {
        self.client.subscriber().unwrap()
    }

    #[allow(unsafe_code, reason = "the test plays the plugin, which writes through the pointer")]
    fn put(&self, number: u64) -> Sent {
        let lent = self.server.loan(Borrower::Callback);
        // SAFETY: the block on loan is for one u64.
        unsafe { lent.value.cast::<u64>().write(number) };
        self.server.publish(lent.value, Borrower::Callback)
    }

    #[allow(unsafe_code, reason = "the test plays the plugin, which reads through the pointer")]
    fn update(&self, wait: Wait, event: impl Fn()) -> Result<u64, Status> {
        let script = Script { now_ns: Cell::new(0), event };
        // SAFETY: a block that was published holds a u64.
        self.client.update(wait, Borrower::Callback, &script).map(|read| unsafe { *read.value.cast::<u64>() })
    }

    fn look(&self) -> Result<u64, Status> {
        self.update(Wait::NONE, || {})
    }

    /// How a wait ends in which this happens.
    fn wait(&self, event: impl Fn()) -> Result<u64, Status> {
        self.put(1);
        self.update(Wait::DEFAULT, event)
    }
}

#[test]
fn the_next_value_ends_it_and_time_does() {
    let rig = rig();
    assert_eq!(rig.wait(|| assert_eq!(rig.put(2), Sent::Ok)), Ok(2));
    assert_eq!(rig.wait(|| {}), Err(Status::Timeout));
    assert_eq!(rig.look(), Ok(1), "what was there is there still");
}

#[test]
fn an_end_of_the_subscription_or_of_the_connection_does() {
    let rig = rig();
    assert_eq!(rig.wait(|| rig.client.unsubscribe()), Err(Status::Unsubscribed));
    rig.subscriber().subscribe(1).unwrap();
    assert_eq!(rig.look(), Err(Status::NoData));
    let cut = || wiring::disconnect(&rig.registry, CLIENT).unwrap();
    assert_eq!(rig.wait(cut), Err(Status::Disconnected));
    assert_eq!(rig.subscriber().subscribe(1), Err(Status::Disconnected));
    rig.connect();
    assert_eq!(rig.look(), Err(Status::Unsubscribed));
    rig.subscriber().subscribe(1).unwrap();
    let cut = || wiring::disconnect(&rig.registry, SERVER).unwrap();
    assert_eq!(rig.wait(cut), Err(Status::Disconnected));
}

#[test]
fn a_server_that_stops_fails_or_leaves_does() {
    let rig = rig();
    assert_eq!(rig.wait(|| rig.server.stop().unwrap()), Err(Status::NotActivated));
    assert_eq!((rig.look(), rig.put(2)), (Err(Status::NotActivated), Sent::NotActivated));
    rig.server.start().unwrap();
    assert_eq!(rig.look(), Err(Status::NoData), "what it had is dropped");
    assert_eq!(rig.wait(|| rig.server.tell(Status::ProviderGone)), Err(Status::ProviderGone));
    assert_eq!(rig.wait(|| rig.server.set_open(Openness::Stopped)), Err(Status::ProviderStopped));
    rig.server.set_open(Openness::Serving);
    rig.server.start().unwrap();
    assert_eq!(rig.wait(|| rig.server.replace()), Err(Status::ProviderReplaced));
    assert_eq!(rig.wait(|| {}), Err(Status::ProviderReplaced), "there is nothing to wait for");
    // The one that succeeds it finds the subscription; somebody else's connection does not.
    wiring::disconnect(&rig.registry, SERVER).unwrap();
    assert_eq!((rig.look(), rig.subscriber().turn().every()), (Err(Status::Disconnected), 1));
    rig.connect();
    assert_eq!(rig.subscriber().turn().every(), 0);
}

#[test]
fn each_of_its_gates_does() {
    let rig = rig();
    for whose in [Whose::Port, Whose::Component] {
        let pulse = || {
            rig.subscriber().blocking(whose, false);
            rig.subscriber().blocking(whose, true);
        };
        assert_eq!(rig.wait(pulse), Err(Status::Cancelled), "though it is open again");
    }
    assert_eq!(rig.wait(|| rig.subscriber().set_blocking(false)), Err(Status::Cancelled));
    assert_eq!(rig.wait(|| {}), Err(Status::Cancelled));
    rig.subscriber().change_hands();
    rig.subscriber().set_blocking(true);
    assert_eq!(rig.wait(|| {}), Err(Status::Timeout));
}

#[test]
fn nobody_waits_for_one_who_waits_for_him() {
    let rig = rig();
    let [server, client] = &rig.waiters;
    assert!(server.begin(client));
    assert_eq!(rig.wait(|| {}), Err(Status::Cycle));
    server.end();
    assert_eq!(rig.wait(|| {}), Err(Status::Timeout));
}

#[test]
fn a_handler_gets_every_second_of_those_that_arrive_and_none_of_an_earlier_subscription() {
    let rig = rig();
    let handled = || std::iter::from_fn(|| rig.subscriber().next()).count();
    (0..5).for_each(|number| assert_eq!(rig.put(number), Sent::Ok));
    assert_eq!((rig.subscriber().waits(), handled(), rig.subscriber().waits()), (true, 3, false));
    (0..20).for_each(|number| assert_eq!(rig.put(number), Sent::Ok));
    assert_eq!(handled(), 4, "the oldest made room");
    assert!(rig.client.counts().1 > 0, "and were counted");
    rig.put(1);
    rig.put(2);
    rig.client.unsubscribe();
    assert_eq!(handled(), 0);
}
