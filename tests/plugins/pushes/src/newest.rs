//! The cases of subscriptions, values, waits, gates and connections.

use std::time::Duration;

use cases::{same, text};
use component_sdk::component::Component as _;
use component_sdk::prelude::*;

use crate::{Hearer, Order, todo};

pub(crate) type Case = Result<(), String>;

pub(crate) const SHORT: Duration = Duration::from_millis(30);
const LONG: Duration = Duration::from_secs(30);
const NEWEST: (&str, &str) = ("listener", "newest");
const FIRST: (&str, &str) = ("sender", "first");
const ALL: u64 = Delivered::All as u64;
const SOME: u64 = Delivered::Some as u64;
const NOBODY: u64 = Delivered::Nobody as u64;

/// Asks the sender.
pub(crate) fn order(listener: &mut Hearer, todo: u32, number: u64) -> Result<u64, String> {
    text(listener.order.query_within(Order { todo, number }, LONG)).map(|told| *told)
}

pub(crate) fn put(listener: &mut Hearer, number: u64) -> Result<u64, String> {
    order(listener, todo::PUT, number)
}

fn value(update: Result<&u64, Status>) -> Result<u64, Status> {
    update.copied()
}

/// Subscribed anew, whatever it was before.
fn fresh(listener: &mut Hearer, prescale: u32) -> Case {
    text(listener.newest.unsubscribe())?;
    text(listener.newest.subscribe(prescale))
}

fn cut(cx: &Context<'_>) -> Case {
    cx.wiring().disconnect(NEWEST).map_err(|refusal| refusal.to_string())
}

fn join(cx: &Context<'_>) -> Case {
    cx.wiring().connect(NEWEST, FIRST).map_err(|refusal| refusal.to_string())
}

/// Which of the next values arrive.
fn arriving(listener: &mut Hearer, numbers: std::ops::RangeInclusive<u64>) -> Result<Vec<u64>, String> {
    let mut seen = Vec::new();
    for number in numbers {
        put(listener, number)?;
        if value(listener.newest.update()) == Ok(number) {
            seen.push(number);
        }
    }
    Ok(seen)
}

pub(crate) fn subscribe_ok(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.newest.unsubscribe())?;
    same(listener.newest.subscribe(1), Ok(()))
}

pub(crate) fn subscribe_twice_ok(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    subscribe_ok(listener, cx)?;
    same(listener.newest.subscribe(1), Ok(()))
}

pub(crate) fn second_subscribe_keeps_the_prescale(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 2)?;
    text(listener.newest.subscribe(1))?;
    same(arriving(listener, 1..=4)?, vec![1, 3])
}

pub(crate) fn subscribe_unconnected(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(listener.loose.subscribe(1), Err(Status::Disconnected))
}

pub(crate) fn subscribe_prescale_zero(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.newest.unsubscribe())?;
    same(listener.newest.subscribe(0), Err(Status::Error))?;
    same(value(listener.newest.update()), Err(Status::Unsubscribed))
}

pub(crate) fn subscribe_needs_no_acknowledgement(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.newest.unsubscribe())?;
    // Its server is in the middle of something.
    let busy = text(listener.order.request(Order { todo: todo::SLEEP, number: 20 }))?;
    same(listener.newest.subscribe(1), Ok(()))?;
    text(listener.order.receive_wait_within(busy, LONG)).map(drop)
}

pub(crate) fn unsubscribe_ok(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.newest.subscribe(1))?;
    same(listener.newest.unsubscribe(), Ok(()))
}

pub(crate) fn unsubscribe_twice_ok(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.newest.unsubscribe())?;
    same(listener.newest.unsubscribe(), Ok(()))
}

pub(crate) fn unsubscribe_drops_the_value(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    fresh(listener, 1)?;
    same(value(listener.newest.update()), Err(Status::NoData))
}

pub(crate) fn update_newest_is_not_consumed(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 5)?;
    same((value(listener.newest.update()), value(listener.newest.update())), (Ok(5), Ok(5)))
}

pub(crate) fn update_no_data(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    same(value(listener.newest.update()), Err(Status::NoData))
}

pub(crate) fn no_data_is_nothing_since_subscription(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    unsubscribe_drops_the_value(listener, cx)
}

pub(crate) fn update_unsubscribed(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    text(listener.newest.unsubscribe())?;
    same(value(listener.newest.update()), Err(Status::Unsubscribed))
}

pub(crate) fn unsubscribed_while_connected(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    update_unsubscribed(listener, cx)
}

pub(crate) fn update_disconnected(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(value(listener.loose.update()), Err(Status::Disconnected))
}

pub(crate) fn new_end_is_not_connected(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    let ends = [value(listener.loose.update()), value(listener.loose.update_wait())];
    same(ends, [Err(Status::Disconnected); 2])
}

pub(crate) fn update_never_from_an_earlier_subscription(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    // Looked at, so that it is on the reader's side already.
    same(value(listener.newest.update()), Ok(1))?;
    fresh(listener, 1)?;
    same(value(listener.newest.update()), Err(Status::NoData))?;
    put(listener, 2)?;
    same(value(listener.newest.update()), Ok(2))
}

pub(crate) fn update_wait_is_for_the_next_arrival(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    same(value(listener.newest.update_wait_within(SHORT)), Err(Status::Timeout))?;
    same(value(listener.newest.update()), Ok(1))?;
    order(listener, todo::PUT_ON, 2)?;
    let next = value(listener.newest.update_wait_within(LONG));
    order(listener, todo::STILL, 0)?;
    same(next, Ok(2))
}

pub(crate) fn wait_without_memory_push(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    update_wait_is_for_the_next_arrival(listener, cx)
}

pub(crate) fn update_wait_cancelled(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    text(listener.newest.blocking(false))?;
    let end = value(listener.newest.update_wait());
    text(listener.newest.blocking(true))?;
    same(end, Err(Status::Cancelled))
}

pub(crate) fn new_waits_are_cancelled_at_once(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    update_wait_cancelled(listener, cx)
}

pub(crate) fn push_has_no_memory_so_is_cancelled(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    text(listener.newest.blocking(false))?;
    let ends = (value(listener.newest.update_wait()), value(listener.newest.update()));
    text(listener.newest.blocking(true))?;
    same(ends, (Err(Status::Cancelled), Ok(1)))
}

pub(crate) fn it_is_a_level(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    text(listener.newest.blocking(false))?;
    let first = value(listener.newest.update_wait());
    same(cx.sleep(SHORT), true)?;
    let second = value(listener.newest.update_wait());
    text(listener.newest.blocking(true))?;
    same((first, second), (Err(Status::Cancelled), Err(Status::Cancelled)))
}

pub(crate) fn flags_not_counters(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    text(listener.newest.blocking(false))?;
    text(listener.newest.blocking(false))?;
    text(listener.newest.blocking(true))?;
    same(value(listener.newest.update_wait_within(SHORT)), Err(Status::Timeout))
}

pub(crate) fn component_blocking_reaches_every_requestor(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    text(listener.second.subscribe(1))?;
    listener.blocking(false);
    let ends = [value(listener.newest.update_wait()), value(listener.second.update_wait())];
    listener.blocking(true);
    text(listener.second.unsubscribe())?;
    same(ends, [Err(Status::Cancelled); 2])
}

pub(crate) fn three_gates_all_must_be_open(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    text(listener.newest.blocking(false))?;
    listener.blocking(false);
    listener.blocking(true);
    let port = value(listener.newest.update_wait());
    text(listener.newest.blocking(true))?;
    listener.blocking(false);
    text(listener.newest.blocking(true))?;
    let component = value(listener.newest.update_wait());
    listener.blocking(true);
    same((port, component), (Err(Status::Cancelled), Err(Status::Cancelled)))?;
    same(value(listener.newest.update_wait_within(SHORT)), Err(Status::Timeout))
}

pub(crate) fn update_wait_unsubscribed(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.newest.unsubscribe())?;
    same(value(listener.newest.update_wait()), Err(Status::Unsubscribed))
}

pub(crate) fn update_wait_disconnected(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(value(listener.loose.update_wait()), Err(Status::Disconnected))
}

pub(crate) fn update_wait_timeout_is_timeout(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    same(value(listener.newest.update_wait_within(SHORT)), Err(Status::Timeout))?;
    // The port's own time.
    same(value(listener.newest.update_wait()), Err(Status::Timeout))
}

pub(crate) fn disconnect_unsubscribes_and_wakes(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    order(listener, todo::CUT_LATER, 0)?;
    let woken = value(listener.newest.update_wait_within(LONG));
    let after = value(listener.newest.update());
    join(cx)?;
    same((woken, after), (Err(Status::Disconnected), Err(Status::Disconnected)))?;
    same(value(listener.newest.update()), Err(Status::Unsubscribed))?;
    text(listener.newest.subscribe(1))?;
    same(value(listener.newest.update()), Err(Status::NoData))
}

pub(crate) fn put_reaches_every_subscriber_in_the_callers_thread(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    text(listener.second.subscribe(1))?;
    same(put(listener, 3)?, ALL)?;
    let both = (value(listener.newest.update()), value(listener.second.update()));
    text(listener.second.unsubscribe())?;
    same(both, (Ok(3), Ok(3)))
}

pub(crate) fn put_says_that_one_failed_and_serves_the_others(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.beside.subscribe(1))?;
    while listener.narrow.take().is_some() {}
    same(order(listener, todo::PUT_NARROW, 1)?, ALL)?;
    same(order(listener, todo::PUT_NARROW, 2)?, SOME)?;
    same((listener.narrow.take().copied(), value(listener.beside.update())), (Some(1), Ok(2)))
}

pub(crate) fn put_reports_any_failing_client(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    put_says_that_one_failed_and_serves_the_others(listener, cx)
}

pub(crate) fn put_without_subscribers_ok(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.timed.unsubscribe())?;
    text(listener.again.unsubscribe())?;
    order(listener, todo::START, 0)?;
    let put = order(listener, todo::PUT_TIMED, 1)?;
    order(listener, todo::STOP, 0)?;
    same(put, NOBODY)?;
    same(order(listener, todo::WRITE, 1)?, Sent::Unconnected as u64)
}

pub(crate) fn buffer_is_one_value(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    (1..=5).try_for_each(|number| put(listener, number).map(drop))?;
    same((value(listener.newest.update()), value(listener.newest.update())), (Ok(5), Ok(5)))
}

pub(crate) fn one_put_wakes_all_waiters(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    let other = text(listener.other.request(Order { todo: todo::WAIT, number: 0 }))?;
    order(listener, todo::PUT_ON, 9)?;
    let own = value(listener.newest.update_wait_within(LONG));
    let others = listener.other.receive_wait_within(other, LONG).map(|value| *value);
    order(listener, todo::STILL, 0)?;
    same((own, others), (Ok(9), Ok(9)))
}

pub(crate) fn connect_ok(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    cut(cx)?;
    join(cx)?;
    fresh(listener, 1)?;
    same((put(listener, 7)?, value(listener.newest.update())), (ALL, Ok(7)))
}

pub(crate) fn connect_disconnects_first(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    put(listener, 1)?;
    cx.wiring().connect(NEWEST, ("others", "values")).map_err(|refusal| refusal.to_string())?;
    let before = value(listener.newest.update());
    text(listener.newest.subscribe(1))?;
    put(listener, 2)?;
    let after = value(listener.newest.update());
    join(cx)?;
    same((before, after), (Err(Status::Unsubscribed), Err(Status::NoData)))
}

pub(crate) fn connect_unknown_service(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    let refusal = cx.wiring().connect(NEWEST, ("sender", "nothing")).err().map(|refusal| refusal.status);
    join(cx)?;
    same(refusal, Some(Status::ServiceUnavailable))
}

pub(crate) fn connect_wrong_type(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    let refusal = cx.wiring().connect(NEWEST, ("others", "first")).err();
    let is_cut = value(listener.newest.update());
    join(cx)?;
    let refusal = refusal.ok_or("it was connected")?;
    same((refusal.status, is_cut), (Status::IncompatibleService, Err(Status::Disconnected)))?;
    same(["others.first", "listener.newest"].map(|name| refusal.reason.contains(name)), [true; 2])
}

pub(crate) fn connect_failed_leaves_disconnected(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    connect_wrong_type(listener, cx)
}

pub(crate) fn disconnect_ok_when_connected(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    cut(cx)?;
    let end = value(listener.newest.update());
    join(cx)?;
    same(end, Err(Status::Disconnected))
}

pub(crate) fn disconnect_ok_when_not_connected(_: &mut Hearer, cx: &mut Context<'_>) -> Case {
    let twice = (cut(cx), cut(cx));
    join(cx)?;
    same(twice, (Ok(()), Ok(())))
}

pub(crate) fn disconnect_of_a_subscribed_client_is_fast(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    // Nobody is asked: a hundred of them end while the server is busy.
    let busy = text(listener.order.request(Order { todo: todo::SLEEP, number: 20 }))?;
    for _ in 0..100 {
        text(listener.newest.subscribe(1))?;
        cut(cx)?;
        same(value(listener.newest.update()), Err(Status::Disconnected))?;
        join(cx)?;
    }
    text(listener.order.receive_wait_within(busy, LONG)).map(drop)
}

pub(crate) fn subscribe_zero_leaves_no_lock(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    subscribe_prescale_zero(listener, cx)?;
    connect_ok(listener, cx)
}

pub(crate) fn own_server_is_a_cycle(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.own.subscribe(1))?;
    same(value(listener.own.update_wait()), Err(Status::Cycle))?;
    same(listener.feed.put(4), Ok(Delivered::All))?;
    same(value(listener.own.update()), Ok(4))
}

pub(crate) fn waiting_for_each_other_is_a_cycle(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    let order = Order { todo: todo::WAIT_BACK, number: 0 };
    match listener.order.query_within(order, LONG).map(|told| *told) {
        Ok(told) => same(told, u64::from(Status::Cycle.code())),
        // The other one was first to wait: whoever closes the ring is told.
        end => {
            same(end, Err(Status::Cycle))?;
            same(listener.feed.put(1), Ok(Delivered::All))
        }
    }
}

pub(crate) fn vector_push_connection(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    cut(cx)?;
    same(listener.newest.subscribe(1), Err(Status::Disconnected))?;
    same(listener.newest.unsubscribe(), Ok(()))?;
    join(cx)?;
    same(value(listener.newest.update()), Err(Status::Unsubscribed))?;
    text(listener.newest.subscribe(1))?;
    same(value(listener.newest.update()), Err(Status::NoData))?;
    put(listener, 1)?;
    same(value(listener.newest.update()), Ok(1))?;
    cut(cx)?;
    same(value(listener.newest.update()), Err(Status::Disconnected))?;
    join(cx)
}

pub(crate) fn vector_push_prescale_2(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 2)?;
    same(arriving(listener, 1..=6)?, vec![1, 3, 5])
}

pub(crate) fn vector_push_two_waiters(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    one_put_wakes_all_waiters(listener, cx)
}

pub(crate) fn crash_releases_push_waits(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    fresh(listener, 1)?;
    // Where it fails before the wait has begun, the wait is for its successor's value.
    for _ in 0..10 {
        order(listener, todo::TRAP_LATER, 0)?;
        match value(listener.newest.update_wait_within(Duration::from_secs(3))) {
            Err(Status::Timeout) => {}
            end => return same(end, Err(Status::ProviderGone)),
        }
    }
    Err("it was never told".to_owned())
}

pub(crate) fn subscription_outlives_the_servers_crash(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    crash_releases_push_waits(listener, cx)?;
    same((put(listener, 8)?, value(listener.newest.update())), (ALL, Ok(8)))
}
