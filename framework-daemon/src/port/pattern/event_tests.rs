//! Both ends of events together, without a component: the test writes what plugins would write.
#![cfg(test)]
#![allow(unsafe_code, reason = "the test plays both plugins, which write and read through pointers")]

use std::cell::Cell;
use std::sync::Arc;

use component_sdk::abi::calls::{Lent, Wait};
use component_sdk::abi::events::{Mode, Which};
use component_sdk::object::{CommObject, Text, TypeDescriptor};
use component_sdk::status::Status;
use proptest::prelude::*;

use super::event_client::{EventClient, Room};
use super::event_server::EventServer;
use super::provider::Openness;
use crate::port::wait::{NotHere, Place, Waiter};
use crate::profile::plan::Overflow;

const ACTIVATIONS: usize = 3;
const QUEUE: usize = 2;
const WAIT: Wait = Wait(1_000);

fn ends(parameter: &'static TypeDescriptor) -> (EventClient, Arc<EventServer>) {
    let room = Room {
        activations: ACTIVATIONS,
        queue: QUEUE,
        overflow: Overflow::DropOldest,
        handled: true,
        timeout_ns: 1_000,
    };
    let client = EventClient::new("level", parameter, u64::DESCRIPTOR, room, Waiter::new());
    let server = Arc::new(EventServer::new("levels", parameter, u64::DESCRIPTOR, false, Waiter::new()));
    server.set_open(Openness::Serving);
    client.connect(&server).unwrap();
    (client, server)
}

fn activate<P: CommObject>(client: &EventClient, mode: Mode, parameter: P) -> Result<u64, Status> {
    let lent = client.loan();
    if lent.status != 0 {
        return Err(Status::from_code(lent.status));
    }
    // SAFETY: lent for a parameter; what is there before is left alone.
    unsafe { lent.value.cast::<P>().write(parameter) };
    client.activate(lent.id, mode).map(|()| lent.id)
}

/// Fires what asked for less.
fn put(server: &EventServer, value: u64) -> usize {
    let (mut testing, mut tests) = (server.first(), 0);
    while testing.status == 0 {
        tests += 1;
        // SAFETY: lent for a parameter and an event.
        let level = unsafe {
            testing.event.cast::<u64>().write(value);
            testing.parameter.cast::<u64>().read()
        };
        testing = server.next(testing.id, value > level);
    }
    tests
}

fn found(lent: &Lent) -> Result<u64, Status> {
    // SAFETY: an event is lent with status 0.
    if lent.status == 0 { Ok(unsafe { lent.value.cast::<u64>().read() }) } else { Err(Status::from_code(lent.status)) }
}

/// Where time goes on by each wait, in which something happens.
struct Moment<F: Fn()> {
    now_ns: Cell<u64>,
    happens: F,
}

impl<F: Fn()> Place for Moment<F> {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    fn park(&self, until_ns: u64) -> Result<(), NotHere> {
        self.now_ns.set(self.now_ns.get() + 1 + (until_ns - self.now_ns.get()) / 2);
        (self.happens)();
        Ok(())
    }
}

fn wait(client: &EventClient, id: u64, which: Which, happens: impl Fn()) -> Result<u64, Status> {
    found(&client.fetch(id, which, WAIT, &Moment { now_ns: Cell::new(7), happens }))
}

#[test]
fn whatever_ends_a_wait_is_told_and_says_whether_the_id_is_gone() {
    type Happens = fn(&EventClient, &Arc<EventServer>, u64);
    let cases: [(Happens, Status, bool); 7] = [
        (|_, _, _| {}, Status::Timeout, true),
        (|client, _, _| client.set_blocking(false), Status::Cancelled, true),
        (|_, server, _| server.set_open(Openness::Stopped), Status::ProviderStopped, true),
        (|_, server, _| server.set_open(Openness::Gone), Status::ProviderGone, true),
        (|_, server, _| server.replace(), Status::ProviderReplaced, false),
        (|client, _, _| client.disconnect(), Status::Disconnected, false),
        (|client, _, id| client.deactivate(id).unwrap_or_default(), Status::NotActivated, false),
    ];
    for mode in [Mode::Single, Mode::Continuous] {
        for which in [Which::Present, Which::Next] {
            for (happens, status, stays) in cases {
                let (client, server) = ends(u64::DESCRIPTOR);
                let id = activate(&client, mode, 5u64).unwrap();
                assert_eq!(wait(&client, id, which, || happens(&client, &server, id)), Err(status));
                assert_eq!(client.state(id), Err(if stays { Status::Active } else { Status::WrongId }));
            }
            let (client, server) = ends(u64::DESCRIPTOR);
            let id = activate(&client, mode, 5u64).unwrap();
            assert_eq!(wait(&client, id, which, || _ = put(&server, 6)), Ok(6));
            let here = |_: u64| Err(NotHere);
            let id = activate(&client, mode, 5u64).unwrap();
            assert_eq!(found(&client.fetch(id, which, WAIT, &here)), Err(Status::Cancelled));
        }
    }
}

#[test]
fn a_parameter_in_a_test_stays_where_it_is_though_its_client_leaves() {
    let (client, server) = ends(u64::DESCRIPTOR);
    let ids = [(); ACTIVATIONS].map(|()| activate(&client, Mode::Continuous, 5u64).unwrap());
    let testing = server.first();
    ids.iter().for_each(|id| client.deactivate(*id).unwrap());
    let again: Vec<_> = std::iter::from_fn(|| activate(&client, Mode::Continuous, 9u64).ok()).take(10).collect();
    assert_eq!(again.len(), ACTIVATIONS - 1, "the one in the test is nobody's yet");
    // SAFETY: lent for a parameter.
    assert_eq!(unsafe { testing.parameter.cast::<u64>().read() }, 5);
    drop(client);
    let over = server.next(testing.id, true);
    assert_eq!(over.status, Status::NoData.code());
    assert_eq!(server.next(testing.id, true).status, Status::WrongId.code(), "a number is used once");
    assert_eq!(server.counts(), (0, 0, 0));
}

#[test]
fn a_failed_server_leaves_activations_but_not_one_whose_parameter_may_be_half_an_object() {
    let (client, server) = ends(u64::DESCRIPTOR);
    let id = activate(&client, Mode::Continuous, 5u64).unwrap();
    assert_eq!(server.first().status, 0);
    server.fail();
    assert_eq!(put(&server, 6), 1);
    assert_eq!(client.state(id), Ok(()));

    let (client, server) = ends(Text::DESCRIPTOR);
    let ids = ["one", "two"].map(|text| activate(&client, Mode::Continuous, Text::from(text)).unwrap());
    assert_eq!(server.first().status, 0);
    let ended = wait(&client, ids[0], Which::Present, || server.fail());
    assert_eq!(ended, Err(Status::ProviderGone));
    assert_eq!(ids.map(|id| client.state(id)), [Err(Status::WrongId), Err(Status::Active)]);
}

#[test]
fn a_client_that_fails_loses_its_activations_and_what_waits_for_its_handler() {
    let (client, server) = ends(u64::DESCRIPTOR);
    let id = activate(&client, Mode::Continuous, 5u64).unwrap();
    put(&server, 6);
    assert!(client.waits());
    let lent = client.loan();
    client.forget();
    assert!(!client.waits() && client.next().is_none());
    assert_eq!((put(&server, 6), client.state(id)), (0, Err(Status::WrongId)));
    assert_eq!(client.activate(lent.id, Mode::Single), Err(Status::WrongId), "what it had on loan is nobody's");
    let again: Vec<_> = std::iter::from_fn(|| activate(&client, Mode::Single, 1u64).ok()).take(10).collect();
    assert_eq!(again.len(), ACTIVATIONS);
}

#[derive(Clone, Debug)]
enum Step {
    Activate(bool, u64),
    Deactivate(usize),
    Put(u64),
    Get(usize, bool),
    Handle,
    Reconnect,
    FailServer,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        3 => (any::<bool>(), 0..10u64).prop_map(|(single, level)| Step::Activate(single, level)),
        1 => (0..8usize).prop_map(Step::Deactivate),
        5 => (0..12u64).prop_map(Step::Put),
        4 => (0..8usize, any::<bool>()).prop_map(|(which, next)| Step::Get(which, next)),
        2 => Just(Step::Handle),
        1 => Just(Step::Reconnect),
        1 => Just(Step::FailServer),
    ]
}

/// An activation as it should be.
struct Known {
    id: u64,
    single: bool,
    level: u64,
    fired: bool,
    event: Option<u64>,
}

impl Known {
    fn get(&mut self, next: bool) -> Result<u64, Status> {
        if self.single && self.fired && (next || self.event.is_none()) {
            return Err(Status::Passive);
        }
        self.event.take_if(|_| !next).ok_or(Status::NoData)
    }
}

proptest! {
    #[test]
    fn whatever_is_done_each_activation_has_what_it_asked_for(steps in prop::collection::vec(step(), 0..150)) {
        let (client, server) = ends(u64::DESCRIPTOR);
        let (mut known, mut gone): (Vec<Known>, Vec<u64>) = (Vec::new(), Vec::new());
        let mut queue: Vec<(u64, u64)> = Vec::new();
        for step in steps {
            match step {
                Step::Activate(single, level) => {
                    let mode = if single { Mode::Single } else { Mode::Continuous };
                    match activate(&client, mode, level) {
                        Ok(id) => known.push(Known { id, single, level, fired: false, event: None }),
                        Err(status) => prop_assert_eq!((status, known.len()), (Status::Overload, ACTIVATIONS)),
                    }
                }
                Step::Deactivate(which) if which < known.len() => {
                    let id = known.remove(which).id;
                    prop_assert_eq!(client.deactivate(id), Ok(()));
                    gone.push(id);
                }
                Step::Put(value) => {
                    prop_assert_eq!(put(&server, value), known.len());
                    // In the order of places, which is in the lower half of the number.
                    known.sort_by_key(|activation| activation.id as u32);
                    for activation in known.iter_mut().filter(|activation| value > activation.level) {
                        if !(activation.single && activation.fired) {
                            (activation.fired, activation.event) = (true, Some(value));
                            queue.push((activation.id, value));
                        }
                    }
                    queue.drain(..queue.len().saturating_sub(QUEUE));
                }
                Step::Get(which, next) if which < known.len() => {
                    let (activation, wanted) = (&mut known[which], if next { Which::Next } else { Which::Present });
                    let got = found(&client.fetch(activation.id, wanted, Wait::NONE, &|_: u64| Err(NotHere)));
                    prop_assert_eq!(got, activation.get(next));
                }
                Step::Handle => {
                    let wanted = loop {
                        if queue.is_empty() {
                            break None;
                        }
                        let (id, value) = queue.remove(0);
                        if known.iter().any(|activation| activation.id == id) {
                            break Some((id, value));
                        }
                    };
                    // SAFETY: a handler is entered with an event.
                    let got = client.next().map(|args| (args.id, unsafe { args.value.cast::<u64>().read() }));
                    prop_assert_eq!(got, wanted);
                    client.served();
                }
                Step::Reconnect => {
                    client.disconnect();
                    prop_assert_eq!(activate(&client, Mode::Single, 0u64), Err(Status::Disconnected));
                    client.connect(&server).unwrap();
                    gone.extend(known.drain(..).map(|activation| activation.id));
                }
                Step::FailServer => {
                    let _ = server.first();
                    server.fail();
                }
                _ => {}
            }
            prop_assert!(gone.iter().all(|id| client.state(*id) == Err(Status::WrongId)));
            prop_assert_eq!(client.counts().0, known.len());
        }
    }
}
