//! What every requestor has, by a query client and an input.

use std::time::Duration;

use cases::{same, table, text};
use component_sdk::prelude::*;

use crate::{Ask, Wirer, number_of, status, todo};

crate::requestor_cases!(table Wirer;);

const ONE: (&str, &str) = ("one", "told");

type Case = Result<(), String>;

/// Connects the wirer's own port as a stranger would.
fn wire(cx: &Context<'_>, port: &str, to: (&str, &str)) -> Result<(), Status> {
    status(cx.wiring().connect(("wirer", port), to))
}

fn new_end_is_not_connected(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    same(wirer.sum(1), Err(Status::Disconnected))
}

fn unlisted_end_is_no_port(_: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(wire(cx, "hidden", ONE), Err(Status::UnknownPort))?;
    same(wire(cx, "overheard", ("speaker", "said")), Err(Status::UnknownPort))
}

fn declared_end_is_a_wireable_port(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(wire(cx, "ask", ONE))?;
    same(wirer.sum(1), Ok(2))
}

fn add_makes_it_wireable(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(status(wirer.hidden.add("shown")))?;
    text(wire(cx, "shown", ONE))?;
    same(number_of(wirer.hidden.query(Ask { todo: todo::ANSWER, number: 1 })), Ok(2))?;
    text(status(wirer.hidden.remove()))
}

fn add_again_renames(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(status(wirer.hidden.add("shown")))?;
    text(status(wirer.hidden.add("known")))?;
    same(wire(cx, "shown", ONE), Err(Status::UnknownPort))?;
    text(wire(cx, "known", ONE))?;
    text(status(wirer.hidden.add("known")))?;
    text(wire(cx, "known", ONE))?;
    text(status(wirer.hidden.remove()))
}

fn add_taken_name_is_refused(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    same(status(wirer.hidden.add("ask")), Err(Status::PortAlreadyUsed))?;
    text(status(wirer.hidden.add("shown")))?;
    same(status(wirer.again.add("shown")), Err(Status::PortAlreadyUsed))?;
    // Each has the name that it had.
    text(wire(cx, "shown", ONE))?;
    text(wire(cx, "again", ONE))?;
    // A name that nobody has any more is free, a declared one, too.
    text(status(wirer.again.remove()))?;
    text(status(wirer.hidden.add("again")))?;
    same(status(wirer.again.add("again")), Err(Status::PortAlreadyUsed))?;
    text(status(wirer.hidden.remove()))?;
    text(status(wirer.again.add("again")))
}

fn add_leaves_the_connection(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    text(status(wirer.ask.add("asks")))?;
    let sum = wirer.sum(1);
    text(status(wirer.ask.add("ask")))?;
    same(sum, Ok(2))
}

fn add_of_no_name_is_an_error(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    let long = "x".repeat(500);
    for name in ["", "a.b", &long] {
        same(status(wirer.hidden.add(name)), Err(Status::Error))?;
    }
    same(wire(cx, "", ONE), Err(Status::UnknownPort))
}

fn remove_hides_it(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(status(wirer.ask.remove()))?;
    let ends = (wire(cx, "ask", ONE), status(cx.wiring().disconnect(("wirer", "ask"))));
    text(status(wirer.ask.add("ask")))?;
    same(ends, (Err(Status::UnknownPort), Err(Status::UnknownPort)))
}

fn remove_of_no_port_is_ok(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.hidden.remove()))?;
    text(status(wirer.hidden.remove()))
}

fn remove_leaves_the_connection(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    text(status(wirer.ask.remove()))?;
    let sum = wirer.sum(1);
    text(status(wirer.ask.add("ask")))?;
    same(sum, Ok(2))
}

fn connect_ok(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("two", "told")))?;
    same(wirer.sum(1), Ok(11))
}

/// Connected to the first server with one question open; how that and the server's answer end when `change` was made.
fn open_question(wirer: &mut Wirer, change: impl FnOnce(&mut Wirer) -> Result<(), Status>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    let open = text(wirer.ask.request(Ask { todo: todo::KEEP, number: 1 }))?;
    text(change(wirer))?;
    same(number_of(wirer.ask.receive_wait(open)), Err(Status::Disconnected))?;
    same(number_of(wirer.ask.receive(open)), Err(Status::WrongId))?;
    // Where the server had not come to it, it never sees it.
    text(status(wirer.again.connect("one", "told")))?;
    let ended = text(number_of(wirer.again.query(Ask { todo: todo::REPORT, number: 0 })))?;
    same(ended == u64::from(Status::Disconnected.code()) || ended == u64::MAX, true)
}

fn connect_disconnects_first(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    open_question(wirer, |wirer| status(wirer.ask.connect("two", "told")))?;
    same(wirer.sum(1), Ok(11))
}

fn connect_to_the_same_disconnects_first(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    open_question(wirer, |wirer| status(wirer.ask.connect("one", "told")))?;
    open_question(wirer, |_| wire(cx, "ask", ONE))?;
    same(wirer.sum(1), Ok(2))
}

fn connect_unknown_service(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    same(status(wirer.ask.connect("nobody", "told")), Err(Status::ServiceUnavailable))?;
    same(status(wirer.ask.connect("one", "tolt")), Err(Status::ServiceUnavailable))?;
    same(status(wirer.ask.connect("one", "onward")), Err(Status::ServiceUnavailable))
}

fn connect_wrong_type(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    same(status(wirer.ask.connect("other", "other")), Err(Status::IncompatibleService))
}

fn connect_failed_leaves_disconnected(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    for (slot, port) in
        [("nobody", "told"), ("one", "tolt"), ("other", "other"), ("speaker", "said"), ("wirer", "again")]
    {
        text(status(wirer.ask.connect("one", "told")))?;
        same(wirer.sum(1), Ok(2))?;
        same(wirer.ask.connect(slot, port).is_err(), true)?;
        same(wirer.sum(1), Err(Status::Disconnected))?;
    }
    Ok(())
}

fn connect_never_waits(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    // The server is in a handler and stays there.
    text(status(wirer.again.connect("one", "told")))?;
    let held = text(wirer.again.request(Ask { todo: todo::HOLD, number: 30 }))?;
    let _ = cx.sleep(Duration::from_millis(2));
    text(status(wirer.ask.connect("one", "told")))?;
    same(number_of(wirer.again.receive(held)), Err(Status::NoData))?;
    same(wirer.sum(1), Ok(2))
}

fn connect_inside_a_callback(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    same(number_of(wirer.ask.query(Ask { todo: todo::ONWARD, number: 5 })), Ok(15))
}

fn disconnect_ok_when_connected(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    text(status(wirer.ask.disconnect()))?;
    same(wirer.sum(1), Err(Status::Disconnected))
}

fn disconnect_ok_when_not_connected(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.disconnect()))?;
    text(status(wirer.ask.disconnect()))
}

fn disconnect_releases_waiters_first(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    same(number_of(wirer.ask.query(Ask { todo: todo::CUT, number: 1 })), Err(Status::Disconnected))
}

fn disconnect_does_not_wait_for_a_hung_server(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(status(wirer.ask.connect("one", "told")))?;
    let held = text(wirer.ask.request(Ask { todo: todo::HOLD, number: 30 }))?;
    let _ = cx.sleep(Duration::from_millis(2));
    text(status(wirer.ask.disconnect()))?;
    same(number_of(wirer.ask.receive(held)), Err(Status::Disconnected))
}

fn blocking_ok_and_no_effect_on_request(wirer: &mut Wirer, _: &mut Context<'_>) -> Case {
    text(wirer.ask.blocking(false))?;
    text(status(wirer.ask.connect("one", "told")))?;
    let asked = wirer.ask.request(Ask { todo: todo::ANSWER, number: 1 });
    text(wirer.ask.blocking(true))?;
    same(number_of(wirer.ask.receive_wait(text(asked)?)), Ok(2))
}

fn reader_connects_itself(wirer: &mut Wirer, cx: &mut Context<'_>) -> Case {
    text(status(wirer.overheard.connect("speaker", "said")))?;
    while wirer.overheard.fresh().is_none() {
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    text(status(wirer.overheard.disconnect()))?;
    let _ = wirer.overheard.fresh();
    let _ = cx.sleep(Duration::from_millis(5));
    // What was on its way.
    let _ = wirer.overheard.fresh();
    let _ = cx.sleep(Duration::from_millis(5));
    same(wirer.overheard.fresh().copied(), None)
}
