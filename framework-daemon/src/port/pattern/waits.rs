//! Every way in which a wait ends. The test plays both plugins and the executor. Random histories against a model are in
//! `tests/src/sim`.
#![cfg(test)]
#![allow(unsafe_code, reason = "the test plays the plugins, which write and read through the pointers")]

use std::sync::Arc;

use component_sdk::abi::calls::{Wait, Whose};
use component_sdk::object::CommObject;
use component_sdk::status::Status;

use super::objects::Objects;
use super::provider::{Openness, Provider};
use super::requestor::{Requestor, Room};
use crate::port::wait::{NotHere, Place, Waiter};
use crate::sys::clock;

const PENDING: usize = 3;
const OBJECTS: Objects = Objects { request: u64::DESCRIPTOR, answer: Some(u64::DESCRIPTOR) };

fn requestor(waiter: &Arc<Waiter>) -> Requestor {
    let room = Room { pending: PENDING, timeout_ns: 1_000_000_000, retry: false };
    Requestor::new("scan", OBJECTS, room, Arc::clone(waiter))
}

fn provider(room: usize) -> Arc<Provider> {
    Arc::new(Provider::new("scans", OBJECTS, room, Waiter::new()))
}

/// A connected pair, serving.
fn pair() -> (Requestor, Arc<Provider>) {
    let (client, server) = (requestor(&Waiter::new()), provider(4));
    server.set_open(Openness::Serving);
    client.connect(&server, None).unwrap();
    (client, server)
}

fn request(client: &Requestor, number: u64) -> Result<u64, Status> {
    let lent = client.loan();
    if lent.status != 0 {
        return Err(Status::from_code(lent.status));
    }
    // SAFETY: lent for a `u64`, to this borrower.
    unsafe { lent.value.cast::<u64>().write(number) };
    client.send(lent.id).map(|()| lent.id)
}

fn never(_: u64) -> Result<(), NotHere> {
    panic!("nobody is to wait here")
}

fn receive(client: &Requestor, id: u64, wait: Wait, park: &impl Place) -> Result<u64, Status> {
    let lent = client.receive(id, wait, park);
    if lent.status != 0 {
        return Err(Status::from_code(lent.status));
    }
    // SAFETY: an answer, lent until it is released.
    let answer = unsafe { *lent.value.cast::<u64>() };
    client.release(id);
    Ok(answer)
}

/// Serves one call, whose answer is the request and one.
fn answer(server: &Provider, id: u64) -> Result<(), Status> {
    let opened = server.opened(id);
    let lent = server.answer_loan(id);
    if lent.status == 0 {
        // SAFETY: both are lent for a `u64`.
        unsafe { lent.value.cast::<u64>().write(*opened.value.cast::<u64>() + 1) };
    }
    server.answer(id)
}

fn serve(server: &Provider) -> Result<(), Status> {
    server.next().map_or(Err(Status::NoData), |call| answer(server, call.id))
}

#[test]
fn many_are_pending_and_received_in_any_order() {
    let (client, server) = pair();
    let ids: Vec<u64> = (0..3).map(|number| request(&client, number).unwrap()).collect();
    assert_eq!(request(&client, 9), Err(Status::Overload), "the table is full");
    assert_eq!(receive(&client, ids[0], Wait::NONE, &never), Err(Status::NoData));
    while serve(&server).is_ok() {}
    for number in [2, 0, 1] {
        assert_eq!(receive(&client, ids[number], Wait::DEFAULT, &never), Ok(number as u64 + 1));
        assert_eq!(receive(&client, ids[number], Wait::DEFAULT, &never), Err(Status::WrongId));
    }
    assert!(request(&client, 9).is_ok());
}

#[test]
fn each_way_in_which_a_wait_ends() {
    type Meanwhile = fn(&Requestor, &Provider);
    let ways: [(Result<u64, Status>, bool, Meanwhile); 8] = [
        (Ok(6), false, |_, server| serve(server).unwrap()),
        (Err(Status::Cancelled), true, |client, _| client.blocking(Whose::Port, false)),
        (Err(Status::Cancelled), true, |client, _| {
            client.set_blocking(false);
            client.set_blocking(true);
        }),
        (Err(Status::Disconnected), false, |client, _| client.disconnect()),
        (Err(Status::ProviderStopped), false, |_, server| server.set_open(Openness::Stopped)),
        (Err(Status::ProviderReplaced), false, |_, server| server.replace()),
        (Err(Status::ProviderGone), false, |_, server| {
            server.next().unwrap();
            server.fail();
        }),
        (Err(Status::Error), false, |_, server| {
            let call = server.next().unwrap();
            server.refuse(call.id, Status::Error).unwrap();
        }),
    ];
    for (expected, id_stays, meanwhile) in ways {
        let (client, server) = pair();
        let id = request(&client, 5).unwrap();
        let park = |_: u64| {
            meanwhile(&client, &server);
            Ok(())
        };
        assert_eq!(receive(&client, id, Wait::DEFAULT, &park), expected);
        let after = receive(&client, id, Wait::NONE, &never);
        assert_eq!(after, Err(if id_stays { Status::NoData } else { Status::WrongId }), "after {expected:?}");
        if id_stays {
            client.blocking(Whose::Port, true);
            assert_eq!(serve(&server), Ok(()));
            assert_eq!(receive(&client, id, Wait::DEFAULT, &never), Ok(6), "nothing was consumed");
        }
    }
}

#[test]
fn a_wait_ends_by_its_deadline_and_keeps_its_id_and_a_query_does_not() {
    let (client, server) = pair();
    let sleep = |until_ns: u64| {
        while clock::now_ns() < until_ns {}
        Ok(())
    };
    let id = request(&client, 1).unwrap();
    assert_eq!(receive(&client, id, Wait(1_000), &sleep), Err(Status::Timeout));
    serve(&server).unwrap();
    assert_eq!(receive(&client, id, Wait(1_000), &never), Ok(2));
    let lent = client.loan();
    assert_eq!(client.ask(lent.id, Wait(1_000), &sleep).status, Status::Timeout.code());
    assert_eq!(client.discard(lent.id), Err(Status::WrongId));
    assert_eq!(serve(&server), Err(Status::NoData), "nobody wants it any more");
}

#[test]
fn data_wins_over_the_gate_and_over_a_disconnection() {
    let (client, server) = pair();
    let (one, two) = (request(&client, 1).unwrap(), request(&client, 2).unwrap());
    serve(&server).unwrap();
    client.blocking(Whose::Port, false);
    assert_eq!(receive(&client, one, Wait::DEFAULT, &never), Ok(2));
    assert_eq!(receive(&client, two, Wait::DEFAULT, &never), Err(Status::Cancelled), "at once, and a level");
    serve(&server).unwrap();
    client.disconnect();
    assert_eq!(receive(&client, two, Wait::DEFAULT, &never), Ok(3));
    assert_eq!(request(&client, 1), Err(Status::Disconnected));
}

#[test]
fn old_numbers_never_revive() {
    let (client, server) = pair();
    let id = request(&client, 1).unwrap();
    let held = server.next().unwrap().id;
    client.disconnect();
    client.connect(&server, None).unwrap();
    assert_eq!(answer(&server, held), Err(Status::Disconnected));
    assert_eq!(answer(&server, held), Err(Status::WrongId), "the entry is gone");
    assert_eq!(receive(&client, id, Wait::NONE, &never), Err(Status::Disconnected));
    assert_eq!(receive(&client, id, Wait::NONE, &never), Err(Status::WrongId));
}

#[test]
fn where_nobody_may_wait_the_wait_is_cancelled() {
    let (client, _server) = pair();
    let id = request(&client, 1).unwrap();
    assert_eq!(receive(&client, id, Wait::DEFAULT, &|_| Err(NotHere)), Err(Status::Cancelled));
}

#[test]
fn a_ring_of_waiting_slots_is_found() {
    let (one, two) = (Waiter::new(), Waiter::new());
    let server = |waiter: &Arc<Waiter>| {
        let server = Arc::new(Provider::new("s", OBJECTS, 4, Arc::clone(waiter)));
        server.set_open(Openness::Serving);
        server
    };
    let (first, second) = (server(&one), server(&two));
    let (asks_second, asks_first, asks_itself) = (requestor(&one), requestor(&two), requestor(&one));
    asks_second.connect(&second, None).unwrap();
    asks_first.connect(&first, None).unwrap();
    asks_itself.connect(&first, None).unwrap();
    let own = request(&asks_itself, 0).unwrap();
    assert_eq!(receive(&asks_itself, own, Wait::DEFAULT, &never), Err(Status::Cycle));
    let id = request(&asks_second, 1).unwrap();
    let park = |_: u64| {
        // The handler of the second asks back.
        let held = second.next().unwrap().id;
        let back = request(&asks_first, 2).unwrap();
        assert_eq!(receive(&asks_first, back, Wait::DEFAULT, &never), Err(Status::Cycle));
        answer(&second, held).unwrap();
        Ok(())
    };
    assert_eq!(receive(&asks_second, id, Wait::DEFAULT, &park), Ok(2));
}

#[test]
fn a_failed_provider_is_asked_again_where_the_connection_says_so() {
    let (client, server) = (requestor(&Waiter::new()), provider(4));
    server.set_open(Openness::Serving);
    client.connect(&server, Some(true)).unwrap();
    let id = request(&client, 5).unwrap();
    let before = server.next().unwrap();
    // SAFETY: as in `answer`; the answer is left half-written.
    unsafe { server.answer_loan(before.id).value.cast::<u64>().write(99) };
    server.fail();
    server.set_open(Openness::Starting);
    assert_eq!(answer(&server, before.id), Err(Status::WrongId), "the number was its predecessor's");
    assert!(server.waits());
    server.set_open(Openness::Serving);
    let again = server.next().unwrap();
    assert!(again.id != before.id && again.value == before.value && !server.waits());
    assert!(!server.answer_loan(again.id).initialised, "what the predecessor left is not looked at");
    answer(&server, again.id).unwrap();
    assert_eq!(receive(&client, id, Wait::NONE, &never), Ok(6));
}

#[test]
fn a_full_inbox_refuses_and_full_hands_take_no_more() {
    let (clients, server) = ([requestor(&Waiter::new()), requestor(&Waiter::new())], provider(2));
    server.set_open(Openness::Serving);
    clients.iter().for_each(|client| client.connect(&server, None).unwrap());
    request(&clients[0], 1).unwrap();
    request(&clients[0], 2).unwrap();
    assert_eq!(request(&clients[1], 3), Err(Status::Overload));
    let in_hand = [server.next().unwrap().id, server.next().unwrap().id];
    request(&clients[1], 3).unwrap();
    assert!(!server.waits() && server.next().is_none());
    answer(&server, in_hand[0]).unwrap();
    assert!(server.waits() && server.next().is_some());
    assert_eq!(server.counts().2, 1);
}

#[test]
fn objects_that_differ_are_refused_with_both_sides_and_leave_the_port_disconnected() {
    let (client, _server) = pair();
    let other =
        Arc::new(Provider::new("other", Objects { answer: Some(f64::DESCRIPTOR), ..OBJECTS }, 4, Waiter::new()));
    let refusal = client.connect(&other, None).unwrap_err();
    assert!(refusal.contains("answer") && refusal.contains("client") && refusal.contains("server"), "{refusal}");
    assert_eq!(request(&client, 1), Err(Status::Disconnected));
}

/// Client and server on two threads: every question gets its own answer, whoever is faster.
#[test]
fn two_threads_lose_and_double_nothing() {
    let (client, server) = pair();
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(std::sync::atomic::Ordering::Relaxed) {
                let _ = serve(&server);
            }
        });
        let yields = |_: u64| {
            std::thread::yield_now();
            Ok(())
        };
        for round in 0..20_000u64 {
            let ids: Vec<(u64, u64)> =
                (0..3).filter_map(|step| Some((round * 3 + step, request(&client, round * 3 + step).ok()?))).collect();
            for (number, id) in ids.iter().rev() {
                if round % 7 == 0 && number % 3 == 1 {
                    assert_eq!(client.discard(*id), Ok(()));
                } else {
                    assert_eq!(receive(&client, *id, Wait::DEFAULT, &yields), Ok(number + 1));
                }
            }
        }
        done.store(true, std::sync::atomic::Ordering::Relaxed);
    });
}
