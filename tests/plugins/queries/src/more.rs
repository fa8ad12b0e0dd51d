//! Further cases: blocking and handlers in detail, and the sequences of the public conformance tests of the originals.

use cases::{same, text};
use component_sdk::component::Component as _;
use component_sdk::prelude::*;

use crate::told::{SHORT, TELL, ask, cut, in_hand, join, let_go, number};
use crate::{Asker, Told, todo};

type Case = Result<(), String>;

pub(crate) fn new_waits_are_cancelled_at_once(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let id = text(asker.tell.request(ask(todo::KEEP, 1)))?;
    text(asker.tell.blocking(false))?;
    let ends = [number(asker.tell.receive_wait(id)), number(asker.tell.receive_wait(id))];
    let look = number(asker.tell.receive(id));
    text(asker.tell.blocking(true))?;
    text(asker.tell.discard(id))?;
    let_go(asker)?;
    same(ends, [Err(Status::Cancelled); 2])?;
    same(look, Err(Status::NoData))
}

pub(crate) fn gates_are_checked_before_blocking(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    asker.blocking(false);
    // Before anything else is looked at that would end a wait: its own service is no cycle then.
    let end = number(asker.own.query(ask(todo::ANSWER, 1)));
    asker.blocking(true);
    same(end, Err(Status::Cancelled))
}

pub(crate) fn cancelling_does_not_consume(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let ids = [in_hand(asker, 1)?, in_hand(asker, 2)?];
    text(asker.tell.blocking(false))?;
    let ends = ids.map(|id| number(asker.tell.receive_wait(id)));
    text(asker.tell.blocking(true))?;
    same(ends, [Err(Status::Cancelled); 2])?;
    same(let_go(asker)?, 2)?;
    same(ids.map(|id| number(asker.tell.receive_wait(id))), [Ok(2), Ok(3)])
}

pub(crate) fn answer_after_a_cancelled_query_is_ok(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    // Closed while the query waits would be another thread's doing: here the server has it before its time is over.
    let end = number(asker.tell.query_within(ask(todo::KEEP, 1), SHORT));
    same(cx.sleep(SHORT), true)?;
    let in_hand = let_go(asker)?;
    let server = number(asker.tell.query(ask(todo::REPORT, 0)));
    same((end, in_hand, server), (Err(Status::Timeout), 1, Ok(0)))
}

pub(crate) fn wait_with_memory_query(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    let id = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    // The answer comes while nobody waits for it.
    same(cx.sleep(SHORT), true)?;
    same(number(asker.tell.query(ask(todo::ANSWER, 2))), Ok(3))?;
    same(number(asker.tell.receive_wait(id)), Ok(2))
}

/// The answer's number, and how many queries the server had handled.
fn both(told: Result<component_sdk::port::Reply<'_, Told>, Status>) -> Result<(u64, u64), String> {
    text(told).map(|told| (told.number, told.handled))
}

pub(crate) fn busy_slot_gets_no_second_callback(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let slow = text(asker.tell.request(ask(todo::SLEEP, 20)))?;
    let next = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    let (_, second) = both(asker.tell.receive_wait(next))?;
    let (told, first) = both(asker.tell.receive(slow))?;
    same((told, second), (21, first + 1))
}

pub(crate) fn parked_callback_is_no_hang(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let (_, before) = both(asker.tell.query(ask(todo::ANSWER, 1)))?;
    // Twice as long as a callback may take.
    let patience = std::time::Duration::from_secs(30);
    let (told, handled) = both(asker.tell.query_within(ask(todo::SLEEP, 200), patience))?;
    let (_, after) = both(asker.tell.query(ask(todo::ANSWER, 1)))?;
    same((told, handled, after), (201, before + 1, before + 2))
}

pub(crate) fn vector_query_connection(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    let mut seen = Vec::new();
    let query = |asker: &mut Asker| number(asker.tell.query(ask(todo::ANSWER, 1)));
    seen.push(query(asker));
    cut(cx)?;
    seen.push(query(asker));
    let disconnected_again = cut(cx);
    let unknown = cx.wiring().connect(TELL, ("teller", "nothing")).is_err();
    seen.push(query(asker));
    join(cx)?;
    seen.push(query(asker));
    let failed = cx.wiring().connect(TELL, ("nobody", "told")).is_err();
    let after_failure = query(asker);
    join(cx)?;
    seen.push(query(asker));
    let disconnected = Err(Status::Disconnected);
    same(seen, vec![Ok(2), disconnected, disconnected, Ok(2), Ok(2)])?;
    same((disconnected_again, unknown, failed), (Ok(()), true, true))?;
    // A slot that is not there is refused before anything is cut; a service that is not there, after.
    same(after_failure == disconnected || after_failure == Ok(2), true)
}

pub(crate) fn vector_query_out_of_order_and_discard(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let mut ids = Vec::new();
    for count in 0..5 {
        ids.push(in_hand(asker, count)?);
    }
    text(asker.tell.discard(ids[2]))?;
    same(let_go(asker)?, 5)?;
    for count in [4, 0, 3, 1] {
        same(number(asker.tell.receive_wait(ids[count])), Ok(count as u64 + 1))?;
        same(number(asker.tell.receive_wait(ids[count])), Err(Status::WrongId))?;
    }
    same(number(asker.tell.receive_wait(ids[2])), Err(Status::WrongId))?;
    same(asker.tell.discard(ids[2]), Err(Status::WrongId))
}

pub(crate) fn vector_query_disconnect_while_others_wait(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    let mine = in_hand(asker, 1)?;
    let other = text(asker.again.request(ask(todo::KEEP, 5)))?;
    same(number(asker.again.query(ask(todo::ANSWER, 1))), Ok(2))?;
    cut(cx)?;
    let end = number(asker.tell.receive_wait(mine));
    join(cx)?;
    same(let_go(asker)?, 2)?;
    same(end, Err(Status::Disconnected))?;
    same(number(asker.again.receive_wait(other)), Ok(6))
}

pub(crate) fn vector_query_two_services(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    const LOOSE: (&str, &str) = ("asker", "loose");
    cx.wiring().connect(LOOSE, ("echo", "told")).map_err(|refusal| refusal.to_string())?;
    let mut ends = Vec::new();
    for count in 0..4 {
        let told = text(asker.tell.request(ask(todo::ANSWER, count)))?;
        let echoed = text(asker.loose.request(ask(todo::ANSWER, count)))?;
        ends.push((number(asker.loose.receive_wait(echoed)), number(asker.tell.receive_wait(told))));
    }
    cx.wiring().disconnect(LOOSE).map_err(|refusal| refusal.to_string())?;
    same(ends, (0..4).map(|count| (Ok(count + 10), Ok(count + 1))).collect())?;
    same(number(asker.loose.query(ask(todo::ANSWER, 5))), Err(Status::Disconnected))
}

pub(crate) fn active_handler_survives_50000(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    for round in 0..7_200 {
        let mut ids = [None; 7];
        for (count, id) in ids.iter_mut().enumerate() {
            *id = Some(text(asker.tell.request(ask(todo::KEEP, round + count as u64)))?);
        }
        same(let_go(asker)?, 7)?;
        for (count, id) in ids.into_iter().enumerate().rev() {
            let id = id.ok_or("requested")?;
            same(number(asker.tell.receive_wait(id)), Ok(round + count as u64 + 1))?;
        }
    }
    Ok(())
}
