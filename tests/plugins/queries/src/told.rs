//! The cases, each named after the line of the tables that it stands for.

use std::time::Duration;

use cases::{same, table, text};
use component_sdk::component::Component as _;
use component_sdk::prelude::*;

use crate::more::{
    active_handler_survives_50000, answer_after_a_cancelled_query_is_ok, busy_slot_gets_no_second_callback,
    cancelling_does_not_consume, gates_are_checked_before_blocking, new_waits_are_cancelled_at_once,
    parked_callback_is_no_hang, vector_query_connection, vector_query_disconnect_while_others_wait,
    vector_query_out_of_order_and_discard, vector_query_two_services, wait_with_memory_query,
};
use crate::server::{
    answer_after_client_left, answer_inside_the_handler, cycle_of_three_over_executors,
    handler_is_called_with_server_id_request, handler_trap_is_contained_and_client_released,
    passive_slow_handler_blocks_its_slot_only, query_disconnected_while_pending, receive_disconnected_consumes,
    receive_wait_disconnected_consumes, server_ids_map_to_client_and_its_id,
};
use crate::{Ask, Asker, Told, todo};

crate::query_cases!(table Asker;);

pub(crate) const SHORT: Duration = Duration::from_millis(30);

pub(crate) fn ask(todo: u32, number: u64) -> Ask {
    Ask { todo, number }
}

pub(crate) fn number(told: Result<component_sdk::port::Reply<'_, Told>, Status>) -> Result<u64, Status> {
    told.map(|told| told.number)
}

/// Has the teller answer what it keeps; how many there were.
pub(crate) fn let_go(asker: &mut Asker) -> Result<u64, String> {
    text(number(asker.tell.query(ask(todo::LET_GO, 0))))
}

fn query_returns_the_answer(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::ANSWER, 5))), Ok(6))?;
    same(asker.tell.query(ask(todo::ANSWER, 7)).map(|told| told.take().number), Ok(8))?;
    let mut request = text(asker.tell.loan())?;
    request.number = 9;
    request.todo = todo::ANSWER;
    same(number(request.query()), Ok(10))
}

fn query_cancelled_discards(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    text(asker.tell.blocking(false))?;
    let ends: Vec<_> = (0..3).map(|_| number(asker.tell.query(ask(todo::KEEP, 1)))).collect();
    text(asker.tell.blocking(true))?;
    same(ends, vec![Err(Status::Cancelled); 3])?;
    // Whether the teller had them in hand already or not: it makes no mistake.
    let_go(asker)?;
    same(number(asker.tell.query(ask(todo::REPORT, 0))), Ok(0))?;
    // All places are free again.
    request_table_full(asker, cx)
}

fn query_not_connected(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.loose.query(ask(todo::ANSWER, 5))), Err(Status::Disconnected))
}

fn query_unanswered_token_is_error(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::FORGET, 5))), Err(Status::Error))
}

fn refused_query_gets_the_servers_status(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::REFUSE, 5))), Err(Status::NotAllowed))
}

fn request_gives_an_id(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let (one, two) = (text(asker.tell.request(ask(todo::ANSWER, 1)))?, text(asker.tell.request(ask(todo::ANSWER, 2)))?);
    same(one == two, false)?;
    same(number(asker.tell.receive_wait(one)), Ok(2))?;
    same(number(asker.tell.receive_wait(two)), Ok(3))
}

fn request_not_connected(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(asker.loose.request(ask(todo::ANSWER, 1)), Err(Status::Disconnected))
}

fn request_table_full(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let ids: Vec<_> = std::iter::from_fn(|| asker.tell.request(ask(todo::ANSWER, 1)).ok()).take(100).collect();
    let full = asker.tell.request(ask(todo::ANSWER, 1));
    for id in &ids {
        same(number(asker.tell.receive_wait(*id)), Ok(2))?;
    }
    same((ids.len(), full), (8, Err(Status::Overload)))
}

fn receive_answer_consumes(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    for _ in 0..1000 {
        match number(asker.tell.receive(id)) {
            Err(Status::NoData) => same(cx.sleep(Duration::from_millis(1)), true)?,
            end => {
                same(end, Ok(2))?;
                return same(number(asker.tell.receive(id)), Err(Status::WrongId));
            }
        }
    }
    Err("no answer".to_owned())
}

fn receive_not_yet(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    same(number(asker.tell.receive(id)), Err(Status::NoData))?;
    same(number(asker.tell.receive(id)), Err(Status::NoData))?;
    let_go(asker)?;
    same(number(asker.tell.receive(id)), Ok(2))
}

fn receive_unknown_id(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    text(asker.tell.discard(id))?;
    same(number(asker.tell.receive(id)), Err(Status::WrongId))?;
    leave_nothing(asker)
}

fn receive_error_consumes(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::FORGET, 1)))?;
    for _ in 0..1000 {
        match number(asker.tell.receive(id)) {
            Err(Status::NoData) => same(cx.sleep(Duration::from_millis(1)), true)?,
            end => {
                same(end, Err(Status::Error))?;
                return same(number(asker.tell.receive(id)), Err(Status::WrongId));
            }
        }
    }
    Err("no end".to_owned())
}

fn receive_wait_answer_consumes(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    same(number(asker.tell.receive_wait(id)), Ok(2))?;
    same(number(asker.tell.receive_wait(id)), Err(Status::WrongId))
}

fn receive_wait_unknown_id(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    text(asker.tell.discard(id))?;
    same(number(asker.tell.receive_wait(id)), Err(Status::WrongId))?;
    leave_nothing(asker)
}

fn receive_wait_cancelled_keeps_id(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    text(asker.tell.blocking(false))?;
    let cancelled = number(asker.tell.receive_wait(id));
    text(asker.tell.blocking(true))?;
    same(cancelled, Err(Status::Cancelled))?;
    let_go(asker)?;
    same(number(asker.tell.receive_wait(id)), Ok(2))
}

fn receive_wait_error_consumes(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::FORGET, 1)))?;
    same(number(asker.tell.receive_wait(id)), Err(Status::Error))?;
    same(number(asker.tell.receive_wait(id)), Err(Status::WrongId))
}

fn receive_wait_timeout_keeps_id(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    let began = cx.clock();
    same(number(asker.tell.receive_wait_within(id, SHORT)), Err(Status::Timeout))?;
    same(cx.clock().since(began) >= SHORT, true)?;
    let_go(asker)?;
    same(number(asker.tell.receive_wait(id)), Ok(2))
}

fn discard_invalidates(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    // The teller has it in hand: what it answers comes too late, and is no mistake of its.
    same(number(asker.tell.receive_wait_within(id, SHORT)), Err(Status::Timeout))?;
    text(asker.tell.discard(id))?;
    same(let_go(asker)?, 1)?;
    same(number(asker.tell.query(ask(todo::REPORT, 0))), Ok(0))?;
    same(number(asker.tell.receive(id)), Err(Status::WrongId))
}

fn discard_unknown_id(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    same(asker.tell.discard(id), Ok(()))?;
    same(asker.tell.discard(id), Err(Status::WrongId))?;
    leave_nothing(asker)
}

/// What was discarded has a place until the server has seen it: when it answers the next one, it has.
fn leave_nothing(asker: &mut Asker) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::ANSWER, 1))), Ok(2))
}

fn many_pending_any_order(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let mut ids = Vec::new();
    for count in 0..7 {
        ids.push((count, text(asker.tell.request(ask(todo::KEEP, count)))?));
    }
    same(let_go(asker)?, 7)?;
    for (count, id) in ids.into_iter().rev() {
        same(number(asker.tell.receive_wait(id)), Ok(count + 1))?;
    }
    Ok(())
}

fn default_deadline_ends_query(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let began = cx.clock();
    same(number(asker.again.query(ask(todo::KEEP, 1))), Err(Status::Timeout))?;
    same(cx.clock().since(began) >= Duration::from_millis(100), true)?;
    let_go(asker).map(|_| ())
}

fn answer_later_from_another_callback(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::LATER, 1))), Ok(2))
}

fn answer_ok(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    let_go(asker)?;
    same(number(asker.tell.query(ask(todo::REPORT, 0))), Ok(0))?;
    same(number(asker.tell.receive_wait(id)), Ok(2))
}

fn active_handler_keeps_the_request(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let kept = text(asker.tell.request(ask(todo::KEEP, 100)))?;
    for count in 0..50 {
        same(number(asker.tell.query(ask(todo::ANSWER, count))), Ok(count + 1))?;
    }
    let_go(asker)?;
    same(number(asker.tell.receive_wait(kept)), Ok(101))
}

fn handler_may_query_itself_others(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::ONWARD, 1))), Ok(11))
}

fn handler_may_wait(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let slow = text(asker.tell.request(ask(todo::SLEEP, 20)))?;
    let next = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    // A slot that waits in its handler is entered by no other one.
    same(number(asker.tell.receive_wait(next)), Ok(2))?;
    same(number(asker.tell.receive(slow)), Ok(21))
}

fn component_blocking_reaches_every_requestor(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    asker.blocking(false);
    let ends = [number(asker.tell.query(ask(todo::KEEP, 1))), number(asker.again.query(ask(todo::KEEP, 1)))];
    asker.blocking(true);
    let_go(asker)?;
    same(ends, [Err(Status::Cancelled); 2])
}

fn three_gates_all_must_be_open(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    asker.blocking(false);
    text(asker.tell.blocking(true))?;
    // Kept: an answer that is there already would win.
    let component = number(asker.tell.query(ask(todo::KEEP, 1)));
    text(asker.tell.blocking(false))?;
    asker.blocking(true);
    let port = number(asker.tell.query(ask(todo::KEEP, 1)));
    text(asker.tell.blocking(true))?;
    same((component, port), (Err(Status::Cancelled), Err(Status::Cancelled)))?;
    // The third one is the slot's, closed before `stop`.
    let_go(asker)?;
    same(number(asker.tell.query(ask(todo::ANSWER, 1))), Ok(2))
}

fn data_wins_over_the_gate(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    let_go(asker)?;
    text(asker.tell.blocking(false))?;
    let answer = number(asker.tell.receive_wait(id));
    text(asker.tell.blocking(true))?;
    same(answer, Ok(2))
}

fn it_is_a_level(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    text(asker.tell.blocking(false))?;
    let first = number(asker.tell.query(ask(todo::KEEP, 1)));
    same(cx.sleep(SHORT), true)?;
    let second = number(asker.tell.query(ask(todo::KEEP, 1)));
    text(asker.tell.blocking(true))?;
    same((first, second), (Err(Status::Cancelled), Err(Status::Cancelled)))?;
    let_go(asker)?;
    same(number(asker.tell.query(ask(todo::ANSWER, 1))), Ok(2))
}

fn flags_not_counters(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    text(asker.tell.blocking(false))?;
    text(asker.tell.blocking(false))?;
    text(asker.tell.blocking(true))?;
    same(number(asker.tell.query(ask(todo::ANSWER, 1))), Ok(2))
}

fn blocking_has_no_effect_on_request(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    text(asker.tell.blocking(false))?;
    let id = asker.tell.request(ask(todo::ANSWER, 1));
    text(asker.tell.blocking(true))?;
    same(number(asker.tell.receive_wait(text(id)?)), Ok(2))
}

fn cycle_of_two_is_answered(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    found_in_a_ring(number(asker.tell.query(ask(todo::BACK, 1))))
}

/// The server was told of the ring and says so; or the asker, where another executor's server was first to wait: whoever closes
/// it is told.
pub(crate) fn found_in_a_ring(end: Result<u64, Status>) -> Result<(), String> {
    match end {
        Ok(told) => same(told, u64::from(Status::Cycle.code())),
        end => same(end, Err(Status::Cycle)),
    }
}

fn own_service_is_a_cycle(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.own.query(ask(todo::ANSWER, 1))), Err(Status::Cycle))
}

fn a_large_number_of_queries_loses_nothing(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    (0..5000).try_for_each(|count| same(number(asker.tell.query(ask(todo::ANSWER, count))), Ok(count + 1)))
}

fn handler_panic_is_contained_and_client_released(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let kept = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    // Unwinding drops the query, which ends it. The instance is sound, and has the other one still.
    same(number(asker.tell.query(ask(todo::PANIC, 1))), Err(Status::Error))?;
    same(let_go(asker)?, 1)?;
    same(number(asker.tell.receive_wait(kept)), Ok(2))
}

fn queued_calls_survive_a_panic(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let panics = text(asker.tell.request(ask(todo::PANIC, 1)))?;
    let queued = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    same(number(asker.tell.receive_wait(queued)), Ok(2))?;
    same(number(asker.tell.receive_wait(panics)), Err(Status::Error))
}

fn server_crash_releases_the_waiter(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::TRAP, 1))), Err(Status::ProviderGone))
}

fn server_crash_next_call(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    same(number(asker.tell.query(ask(todo::TRAP, 1))), Err(Status::ProviderGone))?;
    same(number(asker.tell.query(ask(todo::ANSWER, 1))), Ok(2))
}

fn queued_calls_survive_a_replacement(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let deadly = text(asker.tell.request(ask(todo::TRAP, 1)))?;
    let queued = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    same(number(asker.tell.receive_wait(queued)), Ok(2))?;
    same(number(asker.tell.receive(deadly)), Err(Status::ProviderGone))
}

fn retry_asks_the_successor_once_each(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    // Its timeout may be over before the successor is there: an id outlives that.
    let id = text(asker.again.request(ask(todo::TRAP_ONCE, 1)))?;
    for _ in 0..50 {
        match number(asker.again.receive_wait(id)) {
            Err(Status::Timeout) => same(cx.sleep(SHORT), true)?,
            end => return same(end, Ok(2)),
        }
    }
    Err("no end".to_owned())
}

fn handler_hang_is_ended_and_client_released(asker: &mut Asker, _: &mut Context<'_>) -> Result<(), String> {
    let end = number(asker.tell.query_within(ask(todo::HANG, 1), Duration::from_secs(30)));
    same(end, Err(Status::ProviderGone))
}

pub(crate) const TELL: (&str, &str) = ("asker", "tell");

pub(crate) fn cut(cx: &Context<'_>) -> Result<(), String> {
    cx.wiring().disconnect(TELL).map_err(|refusal| refusal.to_string())
}

pub(crate) fn join(cx: &Context<'_>) -> Result<(), String> {
    cx.wiring().connect(TELL, ("teller", "told")).map_err(|refusal| refusal.to_string())
}

/// A query that the teller has in hand.
pub(crate) fn in_hand(asker: &mut Asker, number: u64) -> Result<QueryId<Told>, String> {
    let id = text(asker.tell.request(ask(todo::KEEP, number)))?;
    // It is served before the next one.
    same(self::number(asker.tell.query(ask(todo::ANSWER, 1))), Ok(2))?;
    Ok(id)
}

fn disconnect_before_the_answer_client(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let id = in_hand(asker, 1)?;
    cut(cx)?;
    let ends = [number(asker.tell.receive_wait(id)), number(asker.tell.receive(id))];
    let unconnected = number(asker.tell.query(ask(todo::ANSWER, 1)));
    join(cx)?;
    let_go(asker)?;
    same(ends, [Err(Status::Disconnected), Err(Status::WrongId)])?;
    same(unconnected, Err(Status::Disconnected))
}

fn disconnect_before_the_answer_server(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let id = in_hand(asker, 1)?;
    cut(cx)?;
    join(cx)?;
    let_go(asker)?;
    let server = number(asker.tell.query(ask(todo::REPORT, 0)));
    same(number(asker.tell.receive(id)), Err(Status::Disconnected))?;
    same(server, Ok(u64::from(Status::Disconnected.code())))
}

fn answer_then_disconnect_then_receive(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let id = in_hand(asker, 1)?;
    let_go(asker)?;
    cut(cx)?;
    let answer = number(asker.tell.receive(id));
    join(cx)?;
    same(answer, Ok(2))
}

fn reconnect_does_not_revive_old_ids(asker: &mut Asker, cx: &mut Context<'_>) -> Result<(), String> {
    let id = in_hand(asker, 1)?;
    cut(cx)?;
    join(cx)?;
    same(number(asker.tell.receive_wait(id)), Err(Status::Disconnected))?;
    same(number(asker.tell.receive_wait(id)), Err(Status::WrongId))?;
    let_go(asker).map(|_| ())
}
