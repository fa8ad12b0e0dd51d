//! Further cases: the server's side, ends in the middle of a wait, and handlers that end.

use std::time::Duration;

use cases::{same, text};
use component_sdk::prelude::*;

use crate::told::{ask, cut, found_in_a_ring, in_hand, join, let_go, number};
use crate::{Asker, todo};

type Case = Result<(), String>;

const LONG: Duration = Duration::from_secs(30);
const LOOSE: (&str, &str) = ("asker", "loose");

pub(crate) fn handler_is_called_with_server_id_request(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let handled = |asker: &mut Asker| text(asker.tell.query(ask(todo::ANSWER, 0)).map(|told| told.handled));
    let before = handled(asker)?;
    let ids = [5, 6, 7].map(|number| asker.tell.request(ask(todo::ANSWER, number)));
    for (count, id) in (1..).zip(ids) {
        let told = text(asker.tell.receive_wait(text(id)?).map(component_sdk::port::Reply::take))?;
        // Once for each, with what was asked.
        same((told.number, told.handled), (count + 5, before + count))?;
    }
    same(handled(asker)?, before + 4)
}

pub(crate) fn answer_inside_the_handler(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    // What the server was told is known when the handler has returned.
    same(number(asker.tell.query(ask(todo::ANSWER_AND_NOTE, 1))), Ok(2))?;
    same(number(asker.tell.query(ask(todo::REPORT, 0))), Ok(0))
}

pub(crate) fn answer_after_client_left(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    let ids = [in_hand(asker, 1)?, in_hand(asker, 2)?];
    cut(cx)?;
    join(cx)?;
    same(let_go(asker)?, 2)?;
    same(number(asker.tell.query(ask(todo::REPORT, 0))), Ok(u64::from(Status::Disconnected.code())))?;
    // The server has them no longer, and the client learns of each once.
    same(let_go(asker)?, 0)?;
    for end in [Status::Disconnected, Status::WrongId] {
        same(ids.map(|id| number(asker.tell.receive(id))), [Err(end); 2])?;
    }
    Ok(())
}

pub(crate) fn server_ids_map_to_client_and_its_id(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let own = in_hand(asker, 10)?;
    let others = text(asker.again.request(ask(todo::KEEP, 20)))?;
    same(number(asker.tell.receive(others)), Err(Status::WrongId))?;
    same(number(asker.again.receive(own)), Err(Status::WrongId))?;
    same(asker.tell.discard(others), Err(Status::WrongId))?;
    same(number(asker.again.query_within(ask(todo::ANSWER, 1), LONG)), Ok(2))?;
    same(let_go(asker)?, 2)?;
    same(number(asker.again.receive_wait(others)), Ok(21))?;
    same(number(asker.tell.receive_wait(own)), Ok(11))
}

pub(crate) fn passive_slow_handler_blocks_its_slot_only(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    let wire = |end: Result<(), component_sdk::wiring::Refusal>| end.map_err(|refusal| refusal.to_string());
    wire(cx.wiring().connect(LOOSE, ("echo", "told")))?;
    // The teller waits in its handler for what the third one keeps.
    let slow = text(asker.tell.request(ask(todo::ONWARD_KEEP, 1)))?;
    while text(number(asker.loose.query_within(ask(todo::KEPT, 0), LONG)))? == 0 {
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    let behind = text(asker.tell.request(ask(todo::ANSWER, 1)))?;
    // Others are served, one on the same executor, too.
    let other = (0..20).all(|count| number(asker.loose.query_within(ask(todo::ANSWER, count), LONG)) == Ok(count + 10));
    let meanwhile = [number(asker.tell.receive(slow)), number(asker.tell.receive(behind))];
    let released = number(asker.loose.query_within(ask(todo::LET_GO, 0), LONG));
    wire(cx.wiring().disconnect(LOOSE))?;
    let ends = [slow, behind].map(|id| number(asker.tell.receive_wait_within(id, LONG)));
    same((other, meanwhile, released), (true, [Err(Status::NoData); 2], Ok(1)))?;
    same(ends, [Ok(11), Ok(2)])
}

pub(crate) fn query_disconnected_while_pending(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    let end = number(asker.tell.query_within(ask(todo::CUT, 1), LONG));
    join(cx)?;
    same(let_go(asker)?, 1)?;
    same(end, Err(Status::Disconnected))
}

pub(crate) fn receive_disconnected_consumes(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    let id = in_hand(asker, 1)?;
    same(number(asker.tell.receive(id)), Err(Status::NoData))?;
    cut(cx)?;
    let ends = [number(asker.tell.receive(id)), number(asker.tell.receive(id))];
    join(cx)?;
    let_go(asker)?;
    same(ends, [Err(Status::Disconnected), Err(Status::WrongId)])
}

pub(crate) fn receive_wait_disconnected_consumes(asker: &mut Asker, cx: &mut Context<'_>) -> Case {
    // The server disconnects its client, which waits.
    let id = text(asker.tell.request(ask(todo::CUT, 1)))?;
    let ends = [(); 2].map(|()| number(asker.tell.receive_wait_within(id, LONG)));
    join(cx)?;
    same(let_go(asker)?, 1)?;
    same(ends, [Err(Status::Disconnected), Err(Status::WrongId)])
}

pub(crate) fn cycle_of_three_over_executors(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    found_in_a_ring(number(asker.tell.query_within(ask(todo::ROUND, 1), LONG)))
}

pub(crate) fn handler_trap_is_contained_and_client_released(asker: &mut Asker, _: &mut Context<'_>) -> Case {
    let kept = in_hand(asker, 1)?;
    same(number(asker.tell.query_within(ask(todo::TRAP, 1), LONG)), Err(Status::ProviderGone))?;
    // What the failed instance had in hand ends as well; its successor serves.
    same(number(asker.tell.receive_wait_within(kept, LONG)), Err(Status::ProviderGone))?;
    same(number(asker.tell.query_within(ask(todo::ANSWER, 1), LONG)), Ok(2))
}
