//! The cases of timed servers, thinning, handlers, and of data ports at the other end.

use std::time::Duration;

use cases::{same, text};
use component_sdk::port::ServerInfo;
use component_sdk::prelude::*;

use crate::newest::{Case, SHORT, order, put};
use crate::{Hearer, todo};

const NOT_ACTIVATED: u64 = 100 + Status::NotActivated.code() as u64;
const PATIENCE: Duration = Duration::from_secs(30);

fn value(update: Result<&u64, Status>) -> Result<u64, Status> {
    update.copied()
}

/// Started anew, both clients subscribed anew.
fn started(listener: &mut Hearer, prescales: [u32; 2]) -> Case {
    order(listener, todo::STOP, 0)?;
    text(listener.timed.unsubscribe())?;
    text(listener.again.unsubscribe())?;
    same(order(listener, todo::START, 0)?, 0)?;
    text(listener.timed.subscribe(prescales[0]))?;
    text(listener.again.subscribe(prescales[1]))
}

/// Which of the next values arrive at each of the two.
fn arriving(listener: &mut Hearer, numbers: std::ops::RangeInclusive<u64>) -> Result<[Vec<u64>; 2], String> {
    let mut seen = [Vec::new(), Vec::new()];
    for number in numbers {
        same(order(listener, todo::PUT_TIMED, number)?, Delivered::All as u64)?;
        for (client, seen) in [&mut listener.timed, &mut listener.again].into_iter().zip(&mut seen) {
            if value(client.update()) == Ok(number) {
                seen.push(number);
            }
        }
    }
    Ok(seen)
}

/// Waits until the handler was entered so often.
fn ticked(listener: &mut Hearer, cx: &Context<'_>, times: u64) -> Case {
    let began = cx.clock();
    while order(listener, todo::TICKS, 0)? < times {
        same(cx.clock().since(began) < PATIENCE, true)?;
        same(cx.sleep(Duration::from_millis(2)), true)?;
    }
    Ok(())
}

pub(crate) fn new_server_is_not_running(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(listener.timed.server_info().map(|info| info.running), Ok(false))
}

pub(crate) fn started_with_its_slot(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    let info = ServerInfo { cycle: Duration::from_millis(10), running: true };
    same(listener.auto.server_info(), Ok(info))?;
    text(listener.auto.subscribe(1))?;
    let first = text(value(listener.auto.update_wait_within(PATIENCE)))?;
    let next = text(value(listener.auto.update_wait_within(PATIENCE)))?;
    text(listener.auto.unsubscribe())?;
    same(next > first, true)
}

pub(crate) fn not_started_subscribe_ok(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(listener.timed.subscribe(1), Ok(()))
}

pub(crate) fn not_started_update_and_wait(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.timed.subscribe(1))?;
    let ends = [value(listener.timed.update()), value(listener.timed.update_wait())];
    same(ends, [Err(Status::NotActivated); 2])
}

pub(crate) fn put_when_stopped(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [3, 3])?;
    same(arriving(listener, 1..=2)?[0].clone(), vec![1])?;
    order(listener, todo::STOP, 0)?;
    same(order(listener, todo::PUT_TIMED, 1)?, NOT_ACTIVATED)
}

pub(crate) fn every_nth_put_first_at_once(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [3, 1])?;
    same(arriving(listener, 1..=7)?[0].clone(), vec![1, 4, 7])
}

pub(crate) fn counter_is_per_client(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [1, 2])?;
    same(arriving(listener, 1..=4)?, [vec![1, 2, 3, 4], vec![1, 3]])?;
    // One that subscribes in between begins its own count.
    text(listener.again.unsubscribe())?;
    text(listener.again.subscribe(2))?;
    same(arriving(listener, 5..=7)?, [vec![5, 6, 7], vec![5, 7]])
}

pub(crate) fn subscribe_below_one(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.timed.unsubscribe())?;
    same(listener.timed.subscribe(0), Err(Status::Error))
}

pub(crate) fn server_info(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [1, 1])?;
    let running = listener.timed.server_info().map(|info| info.running);
    order(listener, todo::STOP, 0)?;
    let stopped = listener.timed.server_info().map(|info| info.running);
    same((running, stopped), (Ok(true), Ok(false)))?;
    let always = ServerInfo { cycle: Duration::ZERO, running: true };
    same(listener.newest.server_info(), Ok(always))
}

pub(crate) fn server_info_unconnected(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(listener.loose.server_info(), Err(Status::Disconnected))
}

pub(crate) fn profile_period_overrides(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(listener.timed.server_info().map(|info| info.cycle), Ok(Duration::from_millis(20)))
}

pub(crate) fn server_stop_drops_value_and_wakes(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [1, 1])?;
    same(arriving(listener, 1..=1)?[0].clone(), vec![1])?;
    order(listener, todo::STOP_LATER, 0)?;
    same(value(listener.timed.update_wait_within(PATIENCE)), Err(Status::NotActivated))?;
    same(order(listener, todo::START, 0)?, 0)?;
    same([value(listener.timed.update()), value(listener.again.update())], [Err(Status::NoData); 2])
}

pub(crate) fn update_wait_timed_not_activated(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    server_stop_drops_value_and_wakes(listener, cx)
}

pub(crate) fn timed_no_data_and_stopped_are_told_apart(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [1, 1])?;
    let started = value(listener.timed.update());
    order(listener, todo::STOP, 0)?;
    same((started, value(listener.timed.update())), (Err(Status::NoData), Err(Status::NotActivated)))
}

pub(crate) fn start_resets_counters_first_tick_at_once(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    started(listener, [3, 3])?;
    same(arriving(listener, 1..=2)?[0].clone(), vec![1])?;
    order(listener, todo::STOP, 0)?;
    same(order(listener, todo::START, 0)?, 0)?;
    ticked(listener, cx, 1)?;
    same(arriving(listener, 3..=4)?[0].clone(), vec![3])
}

pub(crate) fn start_twice_is_no_op(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [3, 3])?;
    same(arriving(listener, 1..=2)?[0].clone(), vec![1])?;
    same(order(listener, todo::START, 0)?, 0)?;
    same(arriving(listener, 3..=4)?[0].clone(), vec![4])
}

pub(crate) fn stop_tells_clients(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [1, 1])?;
    arriving(listener, 1..=1)?;
    order(listener, todo::STOP, 0)?;
    same([value(listener.timed.update()), value(listener.again.update())], [Err(Status::NotActivated); 2])
}

pub(crate) fn stop_twice_is_no_op(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    started(listener, [1, 1])?;
    same([order(listener, todo::STOP, 0)?, order(listener, todo::STOP, 0)?], [0; 2])
}

pub(crate) fn handler_each_cycle(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    started(listener, [1, 1])?;
    ticked(listener, cx, 4)?;
    order(listener, todo::STOP, 0)?;
    let stopped = order(listener, todo::TICKS, 0)?;
    same(cx.sleep(Duration::from_millis(60)), true)?;
    same(order(listener, todo::TICKS, 0)?, stopped)
}

pub(crate) fn counters_count_calls_not_time(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    started(listener, [2, 1])?;
    same(arriving(listener, 1..=1)?[0].clone(), vec![1])?;
    // Many cycles without a call.
    ticked(listener, cx, 4)?;
    same(arriving(listener, 2..=3)?[0].clone(), vec![3])
}

pub(crate) fn put_from_anywhere_with_prescale(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.newest.unsubscribe())?;
    text(listener.newest.subscribe(4))?;
    // From its handler of requests, and from `on_execute`.
    same(put(listener, 1)?, Delivered::All as u64)?;
    order(listener, todo::PUT_ON, 2)?;
    let next = value(listener.newest.update_wait_within(PATIENCE));
    order(listener, todo::STILL, 0)?;
    same(next, Ok(2))
}

pub(crate) fn min_cycle_time_thins(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.thin.subscribe(1))?;
    same((order(listener, todo::PUT_THIN, 1)?, value(listener.thin.update())), (Delivered::All as u64, Ok(1)))?;
    same((order(listener, todo::PUT_THIN, 2)?, value(listener.thin.update())), (Delivered::TooEarly as u64, Ok(1)))
}

pub(crate) fn busy_slot_gets_no_second_callback(listener: &mut Hearer, cx: &mut Context<'_>) -> Case {
    text(listener.handled.subscribe(1))?;
    text(listener.halved.subscribe(1))?;
    (1..=6).try_for_each(|number| put(listener, number).map(drop))?;
    same(cx.sleep(SHORT), true)?;
    same(listener.values.len() + listener.seconds.len(), 0)?;
    // The next case comes when all handlers have run, or never will.
    listener.awaits = 5_000;
    Ok(())
}

pub(crate) fn input_handler_each_arrival(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    listener.awaits = 0;
    text(listener.handled.unsubscribe())?;
    same(listener.values.clone(), vec![1, 2, 3, 4, 5, 6])
}

pub(crate) fn input_handler_prescale(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.halved.unsubscribe())?;
    same(listener.seconds.clone(), vec![1, 3, 5])
}

pub(crate) fn prescale_above_one_is_called(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(listener.seconds.len(), 3)
}

pub(crate) fn data_input_is_subscribed_by_its_connection(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    while listener.data.take().is_some() {}
    (1..=3).try_for_each(|number| put(listener, number).map(drop))?;
    let seen: Vec<u64> = std::iter::from_fn(|| listener.data.take().copied()).collect();
    same(seen, vec![1, 2, 3])
}

pub(crate) fn data_output_feeds_a_client(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    same(value(listener.written.update()), Err(Status::Unsubscribed))?;
    text(listener.written.subscribe(2))?;
    for number in 1..=4 {
        same(order(listener, todo::WRITE, number)?, Sent::Ok as u64)?;
    }
    let newest = value(listener.written.update());
    text(listener.written.unsubscribe())?;
    same(newest, Ok(3))
}

pub(crate) fn profile_prescale_overrides(listener: &mut Hearer, _: &mut Context<'_>) -> Case {
    text(listener.fourths.unsubscribe())?;
    text(listener.fourths.subscribe(1))?;
    while listener.thirds.take().is_some() {}
    let mut fourths = Vec::new();
    for number in 1..=9 {
        put(listener, number)?;
        if value(listener.fourths.update()) == Ok(number) {
            fourths.push(number);
        }
    }
    text(listener.fourths.unsubscribe())?;
    let thirds: Vec<u64> = std::iter::from_fn(|| listener.thirds.take().copied()).collect();
    same(fourths, vec![1, 5, 9])?;
    same(thirds.windows(2).all(|pair| pair[1] - pair[0] == 3) && thirds.len() == 3, true)
}
