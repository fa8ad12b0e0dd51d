//! The cases of the send pattern, each named after the line of the tables that it stands for.

use std::time::Duration;

use cases::{same, table, text};
use component_sdk::prelude::*;

use crate::{Order, Sender, Taken, todo};

crate::send_cases!(table Sender;);

const SHORT: Duration = Duration::from_millis(30);
const ORDER: (&str, &str) = ("sender", "order");
const TAKER: (&str, &str) = ("taker", "orders");

fn order(todo: u32, number: u64) -> Order {
    Order { todo, number, ..Order::default() }
}

fn note(number: u64) -> Order {
    order(todo::NOTE, number)
}

/// What the taker has taken since it was asked last. What was sent before is served before.
fn taken(sender: &mut Sender) -> Result<Taken, String> {
    text(sender.taken.query_within(0, Duration::from_secs(60)).map(component_sdk::port::Reply::take))
}

fn numbers(sender: &mut Sender) -> Result<Vec<u64>, String> {
    Ok(taken(sender)?.numbers.to_vec())
}

/// Until so many were taken, not counting one that may have been lost: all of them.
fn numbers_until(sender: &mut Sender, cx: &Context<'_>, count: usize) -> Result<Vec<u64>, String> {
    let mut all = Vec::new();
    for _ in 0..1000 {
        if let Ok(taken) = taken(sender) {
            all.extend(taken.numbers.iter());
        }
        if all.len() >= count {
            return Ok(all);
        }
        same(cx.sleep(Duration::from_millis(5)), true)?;
    }
    Err(format!("{all:?} only"))
}

fn connect(cx: &Context<'_>, one: (&str, &str), other: (&str, &str)) -> Result<(), Status> {
    cx.wiring().connect(one, other).map_err(|refusal| refusal.status)
}

fn disconnect(cx: &Context<'_>, one: (&str, &str)) -> Result<(), Status> {
    cx.wiring().disconnect(one).map_err(|refusal| refusal.status)
}

fn new_end_is_not_connected(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    same(sender.loose.send(note(1)), Err(Status::Disconnected))
}

fn send_unconnected(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    // Its places are free again each time.
    (0..100).try_for_each(|number| same(sender.loose.send(note(number)), Err(Status::Disconnected)))
}

fn send_handler_gets_the_value(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(Order { remark: "hello".into(), ..note(7) }))?;
    let taken = taken(sender)?;
    same((taken.numbers.to_vec(), taken.remark.as_str()), (vec![7], "hello"))
}

fn send_ok_means_handed_over(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(order(todo::SLEEP, 30)))?;
    text(sender.order.send(note(1)))?;
    let sent_ns = cx.clock().as_nanos();
    let taken = taken(sender)?;
    same((taken.numbers.to_vec(), taken.at_ns > sent_ns), (vec![30, 1], true))
}

fn send_does_not_wait(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(order(todo::SLEEP, 30)))?;
    // It is in the handler, or will be.
    same(cx.sleep(Duration::from_millis(5)), true)?;
    (0..5).try_for_each(|number| text(sender.order.send(note(number))))?;
    same(numbers(sender)?, vec![30, 0, 1, 2, 3, 4])
}

fn send_is_by_value(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    let mut mine = Order { remark: "first".into(), ..note(1) };
    text(sender.order.send(mine.clone()))?;
    (mine.number, mine.remark) = (2, "second".into());
    let taken = taken(sender)?;
    same((taken.numbers.to_vec(), taken.remark.as_str()), (vec![1], "first"))?;
    same((mine.number, mine.remark.as_str()), (2, "second"))
}

fn send_many_clients_one_server(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    for number in 0..6 {
        text(sender.order.send(note(number)))?;
        text(sender.again.send(note(100 + number)))?;
    }
    let all = numbers(sender)?;
    let of = |first: u64| all.iter().copied().filter(|number| number / 100 == first).collect::<Vec<_>>();
    same((of(0), of(1)), ((0..6).collect(), (100..106).collect()))
}

fn send_full_queue_is_overload(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(order(todo::SLEEP, 50)))?;
    let ends: Vec<_> = (0..100).map(|number| sender.order.send(note(number))).collect();
    let sent = ends.iter().take_while(|end| end.is_ok()).count();
    same(ends[sent], Err(Status::Overload))?;
    // Nothing that was accepted is lost, nothing that was not arrives.
    let accepted = (0u64..).zip(&ends).filter(|(_, end)| end.is_ok()).map(|(number, _)| number);
    same(numbers(sender)?, std::iter::once(50).chain(accepted).collect())?;
    text(sender.order.send(note(1)))?;
    same(numbers(sender)?, vec![1])
}

fn send_after_disconnect(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(disconnect(cx, ORDER))?;
    let end = sender.order.send(note(1));
    text(connect(cx, ORDER, TAKER))?;
    same(end, Err(Status::Disconnected))?;
    text(sender.order.send(note(2)))?;
    same(numbers(sender)?, vec![2])
}

fn send_before_disconnect_arrives(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(note(1)))?;
    text(disconnect(cx, ORDER))?;
    text(connect(cx, ORDER, TAKER))?;
    text(sender.order.send(note(2)))?;
    same(numbers(sender)?, vec![1, 2])
}

fn vector_send_connection(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(disconnect(cx, ORDER))?;
    text(disconnect(cx, ORDER))?;
    same(sender.order.send(note(1)), Err(Status::Disconnected))?;
    same(connect(cx, ORDER, ("taker", "nothing")), Err(Status::ServiceUnavailable))?;
    same(sender.order.send(note(2)), Err(Status::Disconnected))?;
    text(connect(cx, ORDER, TAKER))?;
    text(sender.order.send(note(3)))?;
    text(connect(cx, ORDER, TAKER))?;
    text(sender.order.send(note(4)))?;
    same(numbers(sender)?, vec![3, 4])
}

fn vector_send_api(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(note(1)))?;
    // It never waits: whether it may is nothing to it.
    text(sender.order.blocking(false))?;
    let closed = sender.order.send(note(2));
    text(sender.order.blocking(true))?;
    text(closed)?;
    text(disconnect(cx, ORDER))?;
    let cut = (sender.order.blocking(false), sender.order.send(note(3)), sender.order.blocking(true));
    text(connect(cx, ORDER, TAKER))?;
    same(cut, (Ok(()), Err(Status::Disconnected), Ok(())))?;
    text(sender.order.send(note(4)))?;
    same(numbers(sender)?, vec![1, 2, 4])
}

fn send_handler_may_wait(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(order(todo::SLEEP, 20)))?;
    text(sender.order.send(note(1)))?;
    // A slot that waits in its handler is entered by no other one.
    same(numbers(sender)?, vec![20, 1])
}

fn a_dropped_loan_is_not_sent(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    for number in 0..20 {
        let mut loan = text(sender.order.loan())?;
        loan.number = number;
    }
    let mut loan = text(sender.order.loan())?;
    (loan.todo, loan.number) = (todo::NOTE, 5);
    text(loan.send())?;
    same(numbers(sender)?, vec![5])
}

fn blocking_ok_and_no_effect_on_send(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    use component_sdk::component::Component as _;
    same(sender.order.blocking(false), Ok(()))?;
    sender.blocking(false);
    let end = sender.order.send(note(3));
    sender.blocking(true);
    same(sender.order.blocking(true), Ok(()))?;
    same(end, Ok(()))?;
    same(numbers(sender)?, vec![3])
}

fn connect_ok(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    same(connect(cx, ("sender", "loose"), TAKER), Ok(()))?;
    text(sender.loose.send(note(4)))?;
    same(disconnect(cx, ("sender", "loose")), Ok(()))?;
    same(numbers(sender)?, vec![4])
}

fn connect_disconnects_first(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    same(connect(cx, ORDER, ("sender", "told")), Ok(()))?;
    text(sender.order.send(note(5)))?;
    same(connect(cx, ORDER, TAKER), Ok(()))?;
    same(text(sender.told.try_next(cx))?.number, 5)?;
    same(numbers(sender)?, vec![])
}

fn connect_unknown_service(_: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    same(connect(cx, ("sender", "loose"), ("taker", "none")), Err(Status::ServiceUnavailable))?;
    same(connect(cx, ("sender", "loose"), ("nobody", "orders")), Err(Status::ServiceUnavailable))
}

fn connect_wrong_type(_: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let refusal = cx.wiring().connect(("sender", "loose"), ("taker", "numbers")).err();
    let refusal = refusal.ok_or("it was connected")?;
    same(refusal.status, Status::IncompatibleService)?;
    same(refusal.reason.contains("sender.loose sends Order, taker.numbers takes uint64_t"), true)
        .map_err(|_| refusal.reason)
}

fn connect_wrong_pattern(_: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let refusal = cx.wiring().connect(("sender", "loose"), ("taker", "taken")).err();
    let refusal = refusal.ok_or("it was connected")?;
    same(refusal.status, Status::IncompatibleService)?;
    same(refusal.reason.contains("waits for no answer"), true).map_err(|_| refusal.reason)
}

fn connect_failed_leaves_disconnected(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    same(connect(cx, ORDER, ("taker", "numbers")), Err(Status::IncompatibleService))?;
    let end = sender.order.send(note(1));
    text(connect(cx, ORDER, TAKER))?;
    same(end, Err(Status::Disconnected))
}

fn connect_inside_a_callback(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    for number in 0..50 {
        text(disconnect(cx, ORDER))?;
        text(connect(cx, ORDER, TAKER))?;
        text(sender.order.send(note(number)))?;
        same(numbers(sender)?, vec![number])?;
    }
    Ok(())
}

fn disconnect_ok_when_connected(_: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    same((disconnect(cx, ORDER), connect(cx, ORDER, TAKER)), (Ok(()), Ok(())))
}

fn disconnect_ok_when_not_connected(_: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    same(disconnect(cx, ("sender", "loose")), Ok(()))
}

fn disconnected_whatever_disconnect_returned(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let _ = disconnect(cx, ORDER);
    let _ = disconnect(cx, ORDER);
    let end = sender.order.send(note(1));
    text(connect(cx, ORDER, TAKER))?;
    same(end, Err(Status::Disconnected))
}

fn send_queued_by_an_active_server_is_fifo(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    for round in 0..20 {
        (0..5).try_for_each(|number| text(sender.active.send(note(round * 5 + number))))?;
        for number in 0..5 {
            let passed = text(sender.told.next_within(cx, Duration::from_secs(60)))?;
            same(passed.number, round * 5 + number)?;
        }
    }
    Ok(())
}

fn active_handler_is_one_worker_fifo(sender: &mut Sender, _: &mut Context<'_>) -> Result<(), String> {
    let ids = (0..5).map(|number| text(sender.asked.request(number))).collect::<Result<Vec<_>, _>>()?;
    let mut answers = Vec::new();
    for id in ids {
        answers.push(*text(sender.asked.receive_wait_within(id, Duration::from_secs(60)))?);
    }
    let first = answers[0];
    same(answers, (0..5).map(|number| first + number * 1001).collect())
}

fn active_handler_of_another_is_not_allowed(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    same(sender.handled.try_next(cx).err(), Some(Status::NotAllowed))?;
    same(sender.handled.next(cx).err(), Some(Status::NotAllowed))
}

fn active_handler_times_out(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    let began = cx.clock();
    same(sender.told.next_within(cx, SHORT).err(), Some(Status::Timeout))?;
    same(cx.clock().since(began) >= SHORT, true)?;
    same(sender.told.try_next(cx).err(), Some(Status::NoData))
}

fn a_large_number_of_messages_loses_nothing(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    for round in 0..400 {
        (0..5).try_for_each(|number| text(sender.order.send(note(round * 5 + number))))?;
        same(numbers(sender)?, (round * 5..round * 5 + 5).collect())?;
    }
    same(cx.sleep(Duration::from_millis(1)), true)
}

fn handler_panic_is_contained(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    // More often than there are places.
    for number in 0..20 {
        text(sender.order.send(order(todo::PANIC, 1)))?;
        text(sender.order.send(note(number)))?;
        same(numbers_until(sender, cx, 1)?, vec![number])?;
    }
    Ok(())
}

fn server_crash_loses_its_message_only(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    for number in 0..10 {
        text(sender.order.send(order(todo::TRAP, 1)))?;
        text(sender.order.send(note(number)))?;
        same(numbers_until(sender, cx, 1)?, vec![number])?;
    }
    Ok(())
}

fn handler_hang_is_ended(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    text(sender.order.send(order(todo::HANG, 1)))?;
    text(sender.order.send(note(2)))?;
    same(numbers_until(sender, cx, 1)?, vec![2])
}

fn retry_serves_the_successor_once_each(sender: &mut Sender, cx: &mut Context<'_>) -> Result<(), String> {
    // No instance has succeeded another yet.
    text(sender.again.send(order(todo::TRAP_ONCE, 1)))?;
    text(sender.again.send(note(2)))?;
    same(numbers_until(sender, cx, 2)?, vec![1, 2])
}
