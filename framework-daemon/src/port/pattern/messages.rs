//! Messages, and servers that take what comes in by themselves. The test plays both plugins and the executor.
#![cfg(test)]
#![allow(unsafe_code, reason = "the test plays the plugins, which write and read through the pointers")]

use std::cell::Cell;
use std::sync::Arc;

use component_sdk::abi::calls::{ServeKind, Wait};
use component_sdk::object::CommObject;
use component_sdk::status::Status;

use super::objects::Objects;
use super::provider::{Openness, Provider};
use super::requestor::{Requestor, Room};
use crate::port::wait::{NotHere, Waiter};

const MESSAGE: Objects = Objects { request: u64::DESCRIPTOR, answer: None };
const QUERY: Objects = Objects { request: u64::DESCRIPTOR, answer: Some(u64::DESCRIPTOR) };

fn requestor(objects: Objects, retry: bool) -> Requestor {
    Requestor::new("commands", objects, Room { pending: 3, timeout_ns: 1_000, retry }, Waiter::new())
}

fn provider(objects: Objects) -> Arc<Provider> {
    Arc::new(Provider::new("commands", objects, 4, Waiter::new()))
}

fn pair(retry: bool) -> (Requestor, Arc<Provider>) {
    let (client, server) = (requestor(MESSAGE, retry), provider(MESSAGE));
    server.set_open(Openness::Serving);
    client.connect(&server, None).unwrap();
    (client, server)
}

fn send(client: &Requestor, number: u64) -> Result<(), Status> {
    let lent = client.loan();
    if lent.status != 0 {
        return Err(Status::from_code(lent.status));
    }
    // SAFETY: lent for a `u64`, to this borrower.
    unsafe { lent.value.cast::<u64>().write(number) };
    client.send(lent.id)
}

fn read(value: *const u8) -> u64 {
    // SAFETY: a message that the server holds.
    unsafe { *value.cast::<u64>() }
}

/// Handles one message.
fn serve(server: &Provider) -> Option<u64> {
    let served = server.next()?;
    assert_eq!(served.what, ServeKind::Message);
    let number = read(served.value);
    server.refuse(served.id, Status::Error).unwrap();
    assert_eq!(server.refuse(served.id, Status::Error), Err(Status::WrongId), "done with once");
    Some(number)
}

#[test]
fn many_clients_send_to_one_server_each_in_order_and_places_are_used_again() {
    let (one, server) = pair(false);
    let other = requestor(MESSAGE, false);
    other.connect(&server, None).unwrap();
    for round in 0..100 {
        send(&one, round).unwrap();
        send(&other, 1000 + round).unwrap();
        send(&one, 2000 + round).unwrap();
        let taken: Vec<u64> = std::iter::from_fn(|| serve(&server)).collect();
        assert_eq!(taken, [round, 1000 + round, 2000 + round]);
    }
    assert_eq!((one.counts(), server.counts()), ((200, 0), (0, 0, 0)));
}

#[test]
fn a_full_queue_and_a_full_port_say_so_and_nothing_is_lost() {
    let (client, server) = pair(false);
    let other = requestor(MESSAGE, false);
    other.connect(&server, None).unwrap();
    (0..3).for_each(|number| send(&client, number).unwrap());
    assert_eq!(send(&client, 9), Err(Status::Overload), "its own places are all under way");
    send(&other, 3).unwrap();
    assert_eq!(send(&other, 9), Err(Status::Overload), "the server's queue is full");
    assert_eq!(std::iter::from_fn(|| serve(&server)).collect::<Vec<_>>(), [0, 1, 2, 3]);
    send(&other, 4).unwrap();
    assert_eq!(serve(&server), Some(4));
}

#[test]
fn what_was_sent_is_the_servers_whatever_becomes_of_the_sender() {
    let (client, server) = pair(false);
    send(&client, 1).unwrap();
    client.disconnect();
    assert_eq!(send(&client, 2), Err(Status::Disconnected));
    client.connect(&server, None).unwrap();
    send(&client, 3).unwrap();
    client.close_calls();
    drop(client);
    assert_eq!((serve(&server), serve(&server), serve(&server)), (Some(1), Some(3), None));
}

#[test]
fn a_server_that_ends_says_how_and_takes_what_waits_with_it() {
    for (open, status) in [(Openness::Stopped, Status::ProviderStopped), (Openness::Gone, Status::ProviderGone)] {
        let (client, server) = pair(false);
        send(&client, 1).unwrap();
        server.set_open(open);
        assert_eq!(send(&client, 2), Err(status));
        server.set_open(Openness::Serving);
        assert_eq!(serve(&server), None);
        (0..3).for_each(|number| send(&client, number).unwrap());
    }
    let (client, server) = pair(false);
    server.replace();
    assert_eq!(send(&client, 2), Err(Status::ProviderReplaced));
}

#[test]
fn a_failed_handler_takes_its_message_with_it_unless_the_successor_is_to_have_it() {
    for retry in [false, true] {
        let (client, server) = pair(retry);
        (1..=3).for_each(|number| send(&client, number).unwrap());
        assert_eq!(read(server.next().unwrap().value), 1);
        server.fail();
        let left: Vec<u64> = std::iter::from_fn(|| serve(&server)).collect();
        assert_eq!(left, if retry { vec![1, 2, 3] } else { vec![2, 3] });
        (0..3).for_each(|number| send(&client, number).unwrap());
    }
}

#[test]
fn queries_and_messages_do_not_fit() {
    for (asks, answers, word) in [(MESSAGE, QUERY, "waits for no answer"), (QUERY, MESSAGE, "the server gives none")] {
        let difference = requestor(asks, false).connect(&provider(answers), None).unwrap_err();
        assert!(difference.contains(word), "{difference}");
    }
}

/// A message that is there, or the status instead.
fn pull(server: &Provider, wait: Wait, park: impl Fn(u64) -> Result<(), NotHere>) -> Result<u64, Status> {
    let lent = server.pull(wait, &park);
    if lent.status != 0 {
        return Err(Status::from_code(lent.status));
    }
    let number = read(lent.value);
    server.refuse(lent.id, Status::Error).unwrap();
    Ok(number)
}

fn never(_: u64) -> Result<(), NotHere> {
    panic!("nobody is to wait here")
}

#[test]
fn a_server_without_a_handler_takes_its_messages_itself_and_waits_for_them() {
    let client = requestor(MESSAGE, false);
    let server = Arc::new(Provider::new("commands", MESSAGE, 4, Waiter::new()).without_handler());
    server.set_open(Openness::Serving);
    client.connect(&server, None).unwrap();
    assert_eq!(pull(&server, Wait::NONE, never), Err(Status::NoData));
    send(&client, 1).unwrap();
    assert!(server.next().is_none() && !server.waits(), "no handler is entered");
    assert_eq!(pull(&server, Wait::DEFAULT, never), Ok(1));
    let parked = Cell::new(0);
    let looked_at_twice = |_| {
        parked.set(parked.get() + 1);
        if parked.get() == 2 {
            send(&client, 2).unwrap();
        }
        Ok(())
    };
    assert_eq!(pull(&server, Wait::DEFAULT, looked_at_twice), Ok(2));
    assert_eq!(pull(&server, Wait(1), |_| Ok(())), Err(Status::Timeout));
    let stopped = |_| {
        server.set_blocking(false);
        Ok(())
    };
    assert_eq!(pull(&server, Wait::DEFAULT, stopped), Err(Status::Cancelled));
    assert_eq!(pull(&server, Wait::DEFAULT, never), Err(Status::Cancelled), "at once");
    server.set_blocking(true);
    assert_eq!(pull(&server, Wait::DEFAULT, |_| Err(NotHere)), Err(Status::Cancelled));
}

#[test]
fn whoever_holds_all_that_it_may_does_not_wait_for_more() {
    let client = requestor(MESSAGE, false);
    let server = Arc::new(Provider::new("commands", MESSAGE, 2, Waiter::new()).without_handler());
    server.set_open(Openness::Serving);
    client.connect(&server, None).unwrap();
    (0..2).for_each(|number| send(&client, number).unwrap());
    let held = [server.pull(Wait::NONE, &never).id, server.pull(Wait::NONE, &never).id];
    assert_eq!(pull(&server, Wait::DEFAULT, never), Err(Status::Overload));
    server.refuse(held[0], Status::Error).unwrap();
    send(&client, 5).unwrap();
    assert_eq!(pull(&server, Wait::DEFAULT, never), Ok(5));
    let with_handler = provider(MESSAGE);
    assert_eq!(pull(&with_handler, Wait::DEFAULT, never), Err(Status::NotAllowed), "its handler takes them");
}
