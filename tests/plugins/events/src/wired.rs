//! The cases of connections, of event ports, the vectors, and the faults of servers.

use cases::{same, text};
use component_sdk::prelude::*;

use crate::heard::{
    LONG, above, activate_unconnected, armed, asked, await_all, connect, cut, edge, over,
    parameter_is_kept_per_activation_and_mutable, put, single_get_consumed_passive, single_get_waits, value,
};
use crate::{Ask, Crossing, Watcher, todo};

pub(crate) fn new_event_client_is_not_connected(watcher: &mut Watcher, cx: &mut Context<'_>) -> Result<(), String> {
    activate_unconnected(watcher, cx)
}

/// How an attempt to connect ended, and why.
fn attempt(watcher: &mut Watcher, slot: &str, port: &str) -> (Option<Status>, String) {
    match watcher.loose.connect(slot, port) {
        Ok(()) => (None, String::new()),
        Err(refusal) => (Some(refusal.status), refusal.to_string()),
    }
}

pub(crate) fn event_connect_ok(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    same(attempt(watcher, "measurer", "levels").0, None)?;
    let id = text(watcher.loose.activate(Mode::Single, above(1.0)))?;
    same(put(watcher, 2.0)?, 1)?;
    same(value(watcher.loose.get_event(id)), Ok(2.0))
}

pub(crate) fn event_connect_disconnects_first(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(watcher.loose.activate(Mode::Single, above(1.0)))?;
    same(attempt(watcher, "watcher", "mine").0, None)?;
    same(watcher.loose.try_event(id), Err(Status::WrongId))?;
    same(put(watcher, 2.0)?, 0)
}

pub(crate) fn event_connect_to_the_same_disconnects_first(
    watcher: &mut Watcher,
    cx: &mut Context<'_>,
) -> Result<(), String> {
    let id = text(watcher.loose.activate(Mode::Single, above(1.0)))?;
    same(attempt(watcher, "watcher", "mine").0, None)?;
    same(watcher.loose.try_event(id), Err(Status::WrongId))?;
    let id = text(watcher.loose.activate(Mode::Single, above(1.0)))?;
    cx.wiring().connect(("watcher", "loose"), ("watcher", "mine")).map_err(|refusal| refusal.to_string())?;
    same(watcher.loose.try_event(id), Err(Status::WrongId))
}

pub(crate) fn event_connect_unknown_service(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    same(attempt(watcher, "measurer", "nothing").0, Some(Status::ServiceUnavailable))?;
    same(attempt(watcher, "nobody", "levels").0, Some(Status::ServiceUnavailable))
}

fn names_both(text: &str, parts: &[&str]) -> Result<(), String> {
    parts.iter().try_for_each(|part| if text.contains(part) { Ok(()) } else { Err(format!("no `{part}` in `{text}`")) })
}

pub(crate) fn event_connect_wrong_type(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let (status, why) = attempt(watcher, "other", "levels");
    same(status, Some(Status::IncompatibleService))?;
    names_both(&why, &["watcher.loose", "other.levels", "Threshold", "double"])
}

pub(crate) fn event_connect_wrong_pattern(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for (port, what) in [("told", "a service port"), ("tells", "an event output")] {
        let (status, why) = attempt(watcher, "measurer", port);
        same(status, Some(Status::IncompatibleService))?;
        names_both(&why, &["watcher.loose", "a client of events", &format!("measurer.{port}"), what])?;
    }
    Ok(())
}

pub(crate) fn event_connect_failed_leaves_disconnected(
    watcher: &mut Watcher,
    _: &mut Context<'_>,
) -> Result<(), String> {
    for (slot, port) in [("measurer", "nothing"), ("other", "levels"), ("measurer", "told")] {
        same(attempt(watcher, "measurer", "levels").0, None)?;
        text(watcher.loose.activate(Mode::Single, above(1.0)))?;
        same(attempt(watcher, slot, port).0.is_some(), true)?;
        same(watcher.loose.activate(Mode::Single, above(1.0)), Err(Status::Disconnected))?;
    }
    Ok(())
}

pub(crate) fn event_disconnect_ok_connected_or_not(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    same(attempt(watcher, "measurer", "levels").0, None)?;
    for _ in 0..2 {
        watcher.loose.disconnect().map_err(|refusal| refusal.to_string())?;
        same(watcher.loose.activate(Mode::Single, above(1.0)), Err(Status::Disconnected))?;
    }
    Ok(())
}

pub(crate) fn event_disconnect_tells_the_server(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    armed(watcher, Mode::Continuous, above(1.0))?;
    same(put(watcher, 2.0)?, 1)?;
    cut(watcher)?;
    same(put(watcher, 2.0)?, 0)?;
    connect(watcher)?;
    same(put(watcher, 2.0)?, 0)
}

pub(crate) fn own_event_is_a_cycle(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(watcher.own.activate(Mode::Continuous, above(1.0)))?;
    same(value(watcher.own.get_event_within(id, LONG)), Err(Status::Cycle))?;
    let event = Crossing { value: 2.0, ..Crossing::default() };
    text(watcher.mine.put(&event, |parameter, event, state| {
        *event = state.clone();
        state.value > parameter.above
    }))?;
    same(value(watcher.own.get_event_within(id, LONG)), Ok(2.0))?;
    text(watcher.own.deactivate(id))
}

pub(crate) fn event_port_begins(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    asked(watcher, todo::SEND, 5.0)?;
    await_all(watcher, 5 + 3 + 3);
    Ok(())
}

pub(crate) fn event_port_delivers_each_in_order(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    same(&watcher.alarmed, &vec![1, 2, 3, 4, 5])
}

pub(crate) fn event_port_overflow_by_rule(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    await_all(watcher, 0);
    same((&watcher.noted, &watcher.first_noted), (&vec![3, 4, 5], &vec![1, 2, 3]))
}

pub(crate) fn vector_event_connection(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    cut(watcher)?;
    same(watcher.level.activate(Mode::Single, above(1.0)), Err(Status::Disconnected))?;
    connect(watcher)?;
    connect(watcher)?;
    let id = armed(watcher, Mode::Single, above(1.0))?;
    over(watcher, id)?;
    cut(watcher)?;
    cut(watcher)?;
    connect(watcher)
}

pub(crate) fn vector_event_three_activations(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let ids = [1.0, 2.0, 3.0].map(|level| watcher.level.activate(Mode::Continuous, above(level)));
    for (value, fired) in [(1.5, 1), (2.5, 2), (3.5, 3)] {
        put(watcher, value)?;
        let mut count = 0;
        for id in ids {
            let id = text(id)?;
            if watcher.level.try_event(id) == Ok(EventState::Fired) {
                same(watcher.level.get_event(id).map(|event| event.value), Ok(value))?;
                count += 1;
            }
        }
        same(count, fired)?;
    }
    ids.into_iter().try_for_each(|id| over(watcher, text(id)?))
}

pub(crate) fn vector_event_single(watcher: &mut Watcher, cx: &mut Context<'_>) -> Result<(), String> {
    single_get_waits(watcher, cx)?;
    single_get_consumed_passive(watcher, cx)
}

pub(crate) fn vector_event_continuous(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    for number in 2..20 {
        asked(watcher, todo::PUT_LATER, f64::from(number))?;
        same(value(watcher.level.get_next_event_within(id, LONG)), Ok(f64::from(number)))?;
    }
    over(watcher, id)
}

pub(crate) fn vector_event_threshold(watcher: &mut Watcher, cx: &mut Context<'_>) -> Result<(), String> {
    parameter_is_kept_per_activation_and_mutable(watcher, cx)
}

pub(crate) fn a_panic_in_a_test_is_contained(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    let end = watcher.ask.query_within(Ask { todo: todo::PANIC_IN_TEST, value: 2.0 }, LONG).map(drop);
    same(end, Err(Status::Error))?;
    // Its parameter is whole, and so is the activation.
    put(watcher, 2.0)?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    over(watcher, id)
}

pub(crate) fn parameters_survive_a_replaced_server(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, edge(1.0))?;
    put(watcher, 2.0)?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    let end = watcher.ask.query_within(Ask { todo: todo::TRAP, value: 0.0 }, LONG).map(drop);
    same(end, Err(Status::ProviderGone))?;
    // It remembers that it was above.
    same(put(watcher, 3.0)?, 1)?;
    same(watcher.level.try_event(id), Ok(EventState::Active))?;
    put(watcher, 0.0)?;
    put(watcher, 4.0)?;
    same(value(watcher.level.get_event(id)), Ok(4.0))?;
    over(watcher, id)
}

pub(crate) fn a_wait_goes_on_with_the_servers_successor(
    watcher: &mut Watcher,
    _: &mut Context<'_>,
) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    asked(watcher, todo::TRAP_LATER, 7.0)?;
    same(value(watcher.level.get_event_within(id, LONG)), Ok(7.0))?;
    over(watcher, id)
}

pub(crate) fn a_parameter_left_half_changed_is_nobodys(
    watcher: &mut Watcher,
    _: &mut Context<'_>,
) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    let other = armed(watcher, Mode::Continuous, above(1.0))?;
    let end = watcher.ask.query_within(Ask { todo: todo::TRAP_IN_TEST, value: 2.0 }, LONG).map(drop);
    same(end, Err(Status::ProviderGone))?;
    // The first one was in the test, and owns a text.
    same(put(watcher, 3.0)?, 1)?;
    same(watcher.level.try_event(id), Err(Status::WrongId))?;
    same(value(watcher.level.get_event(other)), Ok(3.0))?;
    over(watcher, other)
}
