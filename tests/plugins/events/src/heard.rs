//! The cases.

use std::time::Duration;

use cases::{same, table, text};
use component_sdk::component::Component as _;
use component_sdk::prelude::*;

use crate::wired::*;
use crate::{Ask, Crossing, Threshold, Told, Watcher, event_cases, todo};

event_cases!(table Watcher;);

const SHORT: Duration = Duration::from_millis(30);
/// Far longer than anything here takes.
pub(crate) const LONG: Duration = Duration::from_secs(30);

/// Told each time that the value is above.
pub(crate) fn above(level: f64) -> Threshold {
    Threshold { above: level, always: true, label: "plain".into(), ..Threshold::default() }
}

/// Told when the value comes above.
pub(crate) fn edge(level: f64) -> Threshold {
    Threshold { always: false, ..above(level) }
}

pub(crate) fn asked(watcher: &mut Watcher, todo: u32, value: f64) -> Result<Told, String> {
    text(watcher.ask.query_within(Ask { todo, value }, LONG).map(|told| told.clone()))
}

/// Has the measurer put a value; how many tests ran.
pub(crate) fn put(watcher: &mut Watcher, value: f64) -> Result<u64, String> {
    let told = asked(watcher, todo::PUT, value)?;
    if told.status == 0 { Ok(told.tests) } else { Err(format!("the put ended with {}", told.status)) }
}

pub(crate) fn armed(watcher: &mut Watcher, mode: Mode, parameter: Threshold) -> Result<EventId<Crossing>, String> {
    text(watcher.level.activate(mode, parameter))
}

pub(crate) fn over(watcher: &mut Watcher, id: EventId<Crossing>) -> Result<(), String> {
    text(watcher.level.deactivate(id))
}

pub(crate) fn value(event: Result<&Crossing, Status>) -> Result<f64, Status> {
    event.map(|event| event.value)
}

const BOTH: [Mode; 2] = [Mode::Single, Mode::Continuous];

fn activate_ok_many_ids(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for mode in BOTH {
        let ids: Vec<_> = std::iter::from_fn(|| watcher.level.activate(mode, above(1.0)).ok()).take(100).collect();
        let full = watcher.level.activate(mode, above(1.0));
        same((ids.len(), full), (16, Err(Status::Overload)))?;
        let different: std::collections::HashSet<_> = ids.iter().map(|id| format!("{id:?}")).collect();
        same(different.len(), 16)?;
        ids.into_iter().try_for_each(|id| over(watcher, id))?;
    }
    Ok(())
}

pub(crate) fn activate_unconnected(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    BOTH.into_iter().try_for_each(|mode| same(watcher.loose.activate(mode, above(1.0)), Err(Status::Disconnected)))
}

fn deactivate_ok(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for mode in BOTH {
        let id = armed(watcher, mode, above(1.0))?;
        same(put(watcher, 0.0)?, 1)?;
        over(watcher, id)?;
        same(put(watcher, 0.0)?, 0)?;
    }
    Ok(())
}

fn deactivate_wrong_id(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for mode in BOTH {
        let id = armed(watcher, mode, above(1.0))?;
        over(watcher, id)?;
        same(watcher.level.deactivate(id), Err(Status::WrongId))?;
        // The place is used again; the old number stays wrong.
        let next = armed(watcher, mode, above(1.0))?;
        same(watcher.level.deactivate(id), Err(Status::WrongId))?;
        same(watcher.level.try_event(id), Err(Status::WrongId))?;
        same(value(watcher.level.get_event(id)), Err(Status::WrongId))?;
        same(value(watcher.level.get_next_event(id)), Err(Status::WrongId))?;
        over(watcher, next)?;
    }
    Ok(())
}

fn single_needs_deactivate_after_firing(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    put(watcher, 2.0)?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    let others: Vec<_> =
        std::iter::from_fn(|| watcher.level.activate(Mode::Single, above(1.0)).ok()).take(100).collect();
    same(others.len(), 15)?;
    others.into_iter().chain([id]).try_for_each(|id| over(watcher, id))
}

fn deactivate_after_disconnect(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    cut(watcher)?;
    same(watcher.level.deactivate(id), Err(Status::WrongId))?;
    connect(watcher)
}

pub(crate) fn connect(watcher: &mut Watcher) -> Result<(), String> {
    watcher.level.connect("measurer", "levels").map_err(|refusal| format!("{refusal:?}"))
}

pub(crate) fn cut(watcher: &mut Watcher) -> Result<(), String> {
    watcher.level.disconnect().map_err(|refusal| format!("{refusal:?}"))
}

fn single_try_active_fired_passive(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    same(watcher.level.try_event(id), Ok(EventState::Active))?;
    put(watcher, 0.5)?;
    same(watcher.level.try_event(id), Ok(EventState::Active))?;
    put(watcher, 2.0)?;
    same(watcher.level.try_event(id), Ok(EventState::Fired))?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    same(watcher.level.try_event(id), Ok(EventState::Passive))?;
    over(watcher, id)?;
    same(watcher.level.try_event(id), Err(Status::WrongId))
}

fn continuous_try_fired_active(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    put(watcher, 2.0)?;
    same(watcher.level.try_event(id), Ok(EventState::Fired))?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    same(watcher.level.try_event(id), Ok(EventState::Active))?;
    over(watcher, id)?;
    same(watcher.level.try_event(id), Err(Status::WrongId))
}

fn try_does_not_consume(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for mode in BOTH {
        let id = armed(watcher, mode, above(1.0))?;
        put(watcher, 2.0)?;
        for _ in 0..3 {
            same(watcher.level.try_event(id), Ok(EventState::Fired))?;
        }
        same(value(watcher.level.get_event(id)), Ok(2.0))?;
        over(watcher, id)?;
    }
    Ok(())
}

fn single_get_unconsumed(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, Threshold { label: "mine".into(), ..above(1.0) })?;
    put(watcher, 2.0)?;
    let event = watcher.level.get_event(id).cloned();
    same(event, Ok(Crossing { value: 2.0, label: "mine".into(), before: 0.0 }))?;
    over(watcher, id)
}

pub(crate) fn single_get_consumed_passive(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    put(watcher, 2.0)?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    put(watcher, 3.0)?;
    // At once, though it would wait for long.
    same(value(watcher.level.get_event_within(id, LONG)), Err(Status::Passive))?;
    over(watcher, id)
}

fn get_waits(watcher: &mut Watcher, mode: Mode) -> Result<(), String> {
    let id = armed(watcher, mode, above(1.0))?;
    asked(watcher, todo::PUT_LATER, 2.0)?;
    same(value(watcher.level.get_event_within(id, LONG)), Ok(2.0))?;
    over(watcher, id)
}

pub(crate) fn single_get_waits(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    get_waits(watcher, Mode::Single)
}

fn continuous_get_newest(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    put(watcher, 2.0)?;
    put(watcher, 3.0)?;
    same(value(watcher.level.get_event(id)), Ok(3.0))?;
    put(watcher, 4.0)?;
    same(value(watcher.level.get_event(id)), Ok(4.0))?;
    over(watcher, id)
}

fn continuous_get_waits(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    get_waits(watcher, Mode::Continuous)
}

fn single_next_after_fired_passive(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    put(watcher, 2.0)?;
    same(value(watcher.level.get_next_event_within(id, LONG)), Err(Status::Passive))?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    over(watcher, id)
}

fn single_next_waits(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    asked(watcher, todo::PUT_LATER, 2.0)?;
    same(value(watcher.level.get_next_event_within(id, LONG)), Ok(2.0))?;
    over(watcher, id)
}

fn continuous_next_ignores_buffered(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    put(watcher, 2.0)?;
    same(value(watcher.level.get_next_event_within(id, SHORT)), Err(Status::Timeout))?;
    same(watcher.level.try_event(id), Ok(EventState::Fired))?;
    asked(watcher, todo::PUT_LATER, 3.0)?;
    same(value(watcher.level.get_next_event_within(id, LONG)), Ok(3.0))?;
    over(watcher, id)
}

fn waiting_cancelled_keeps_id(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for mode in BOTH {
        let id = armed(watcher, mode, above(1.0))?;
        text(watcher.level.blocking(false))?;
        same(value(watcher.level.get_event(id)), Err(Status::Cancelled))?;
        same(value(watcher.level.get_next_event(id)), Err(Status::Cancelled))?;
        text(watcher.level.blocking(true))?;
        same(watcher.level.try_event(id), Ok(EventState::Active))?;
        put(watcher, 2.0)?;
        same(value(watcher.level.get_event(id)), Ok(2.0))?;
        over(watcher, id)?;
    }
    Ok(())
}

fn waiting_disconnected_id_gone(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for (mode, next) in [(Mode::Single, false), (Mode::Continuous, true)] {
        let id = armed(watcher, mode, above(1.0))?;
        asked(watcher, todo::CUT_LATER, 0.0)?;
        let level = &mut watcher.level;
        let end = if next { level.get_next_event_within(id, LONG) } else { level.get_event_within(id, LONG) };
        same(value(end), Err(Status::Disconnected))?;
        same(value(watcher.level.get_event(id)), Err(Status::WrongId))?;
        connect(watcher)?;
        same(watcher.level.try_event(id), Err(Status::WrongId))?;
    }
    Ok(())
}

fn get_timeout(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for mode in BOTH {
        let id = armed(watcher, mode, above(1.0))?;
        same(value(watcher.level.get_event_within(id, SHORT)), Err(Status::Timeout))?;
        put(watcher, 2.0)?;
        same(value(watcher.level.get_event(id)), Ok(2.0))?;
        over(watcher, id)?;
    }
    Ok(())
}

fn next_timeout(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    for mode in BOTH {
        let id = armed(watcher, mode, above(1.0))?;
        same(value(watcher.level.get_next_event_within(id, SHORT)), Err(Status::Timeout))?;
        over(watcher, id)?;
    }
    Ok(())
}

fn default_deadline_ends_an_event_wait(watcher: &mut Watcher, cx: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    let began = cx.clock();
    same(value(watcher.level.get_event(id)), Err(Status::Timeout))?;
    // The profile says 100 ms.
    same(cx.clock().since(began) >= Duration::from_millis(100), true)?;
    over(watcher, id)
}

fn several_waiters_same_event(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let ids = [armed(watcher, Mode::Single, above(1.0))?, armed(watcher, Mode::Continuous, above(1.0))?];
    asked(watcher, todo::PUT_LATER, 2.0)?;
    for id in ids {
        same(value(watcher.level.get_event_within(id, LONG)), Ok(2.0))?;
        over(watcher, id)?;
    }
    Ok(())
}

fn storage_is_one_event_overwritten(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    [2.0, 3.0, 4.0].into_iter().try_for_each(|value| put(watcher, value).map(drop))?;
    same(value(watcher.level.get_event(id)), Ok(4.0))?;
    same(watcher.level.try_event(id), Ok(EventState::Active))?;
    over(watcher, id)
}

/// What the handlers are to have got when the next case begins.
pub(crate) fn await_all(watcher: &mut Watcher, count: usize) {
    (watcher.awaited, watcher.patience) = (count, 10_000);
}

fn client_handler_begins(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = text(watcher.heard.activate(Mode::Continuous, above(1.0)))?;
    [2.0, 3.0].into_iter().try_for_each(|value| put(watcher, value).map(drop))?;
    // The handler is not entered in the middle of a callback; the newest is stored besides.
    same(watcher.crossings.len(), 0)?;
    same(value(watcher.heard.get_event(id)), Ok(3.0))?;
    await_all(watcher, 2);
    Ok(())
}

fn client_handler_for_every_firing(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    same(std::mem::take(&mut watcher.crossings), vec![2.0, 3.0])?;
    await_all(watcher, 0);
    watcher.heard.disconnect().map_err(|refusal| format!("{refusal:?}"))?;
    watcher.heard.connect("measurer", "levels").map_err(|refusal| format!("{refusal:?}"))
}

fn put_tests_every_activation_of_every_client(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let one = armed(watcher, Mode::Single, above(1.0))?;
    let two = armed(watcher, Mode::Continuous, above(9.0))?;
    let other = text(watcher.heard.activate(Mode::Single, above(9.0)))?;
    same(put(watcher, 2.0)?, 3)?;
    text(watcher.heard.deactivate(other))?;
    same(put(watcher, 2.0)?, 2)?;
    over(watcher, one)?;
    over(watcher, two)?;
    same(put(watcher, 2.0)?, 0)
}

fn test_true_fires_that_activation(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let (low, high) = (armed(watcher, Mode::Single, above(1.0))?, armed(watcher, Mode::Single, above(5.0))?);
    put(watcher, 2.0)?;
    same(watcher.level.try_event(low), Ok(EventState::Fired))?;
    same(watcher.level.try_event(high), Ok(EventState::Active))?;
    over(watcher, low)?;
    over(watcher, high)
}

pub(crate) fn parameter_is_kept_per_activation_and_mutable(
    watcher: &mut Watcher,
    _: &mut Context<'_>,
) -> Result<(), String> {
    let (low, high) = (armed(watcher, Mode::Continuous, edge(1.0))?, armed(watcher, Mode::Continuous, edge(5.0))?);
    let mut seen = Vec::new();
    for value in [2.0, 3.0, 6.0, 7.0, 4.0, 6.0, 0.0, 2.0] {
        put(watcher, value)?;
        for (id, name) in [(low, "low"), (high, "high")] {
            if watcher.level.try_event(id) == Ok(EventState::Fired) {
                seen.push((name, text(watcher.level.get_event(id))?.value));
            }
        }
    }
    same(seen, vec![("low", 2.0), ("high", 6.0), ("high", 6.0), ("low", 2.0)])?;
    over(watcher, low)?;
    over(watcher, high)
}

fn single_is_not_sent_again_test_still_runs(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    same((put(watcher, 2.0)?, put(watcher, 3.0)?), (1, 1))?;
    same(value(watcher.level.get_event(id)), Ok(2.0))?;
    over(watcher, id)
}

fn on_activation_hook(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let before = asked(watcher, todo::PUT, 0.0)?.activations;
    let ids = [armed(watcher, Mode::Single, above(1.0))?, armed(watcher, Mode::Single, above(1.0))?];
    let uncounted = Threshold { label: "uncounted".into(), ..above(1.0) };
    let other = armed(watcher, Mode::Continuous, uncounted)?;
    put(watcher, 0.0)?;
    same(asked(watcher, todo::PUT, 0.0)?.activations, before + 2)?;
    ids.into_iter().chain([other]).try_for_each(|id| over(watcher, id))
}

fn event_is_fresh_for_each_activation(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let ids = [(); 3].map(|()| watcher.level.activate(Mode::Continuous, above(1.0)));
    for _ in 0..5 {
        put(watcher, 2.0)?;
        for id in ids {
            let id = text(id)?;
            same(watcher.level.get_event(id).map(|event| event.before), Ok(0.0))?;
        }
    }
    ids.into_iter().try_for_each(|id| over(watcher, text(id)?))
}

fn put_says_that_one_failed(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    // Two wait for the handler at most, which is not entered meanwhile.
    let handled = text(watcher.heard.activate(Mode::Continuous, above(1.0)))?;
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    put(watcher, 2.0)?;
    put(watcher, 3.0)?;
    same(asked(watcher, todo::PUT, 4.0)?.status, Status::Overload.code())?;
    same(value(watcher.level.get_event(id)), Ok(4.0))?;
    same(value(watcher.heard.get_event(handled)), Ok(4.0))?;
    text(watcher.heard.deactivate(handled))?;
    same(put(watcher, 5.0)?, 1)?;
    over(watcher, id)
}

fn put_without_activations_ok(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    // Those that waited for the handler belonged to an activation that is over.
    same(watcher.crossings.len(), 0)?;
    same(put(watcher, 2.0)?, 0)?;
    text(watcher.mine.put(&Crossing::default(), |_, _, _| true))
}

fn event_wait_has_memory(watcher: &mut Watcher, cx: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    asked(watcher, todo::PUT_LATER, 2.0)?;
    same(cx.sleep(Duration::from_millis(200)), true)?;
    same(value(watcher.level.get_event_within(id, LONG)), Ok(2.0))?;
    over(watcher, id)
}

fn event_data_wins_over_the_gate(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Continuous, above(1.0))?;
    put(watcher, 2.0)?;
    text(watcher.level.blocking(false))?;
    let ends = (value(watcher.level.get_event(id)), value(watcher.level.get_event(id)));
    text(watcher.level.blocking(true))?;
    same(ends, (Ok(2.0), Err(Status::Cancelled)))?;
    // The next one has no memory: the gate is all that counts.
    put(watcher, 3.0)?;
    text(watcher.level.blocking(false))?;
    let end = value(watcher.level.get_next_event(id));
    text(watcher.level.blocking(true))?;
    same(end, Err(Status::Cancelled))?;
    over(watcher, id)
}

fn event_gate_is_a_level_and_no_counter(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let id = armed(watcher, Mode::Single, above(1.0))?;
    text(watcher.level.blocking(false))?;
    text(watcher.level.blocking(false))?;
    let ends = [(); 3].map(|()| value(watcher.level.get_event(id)));
    text(watcher.level.blocking(true))?;
    same(ends, [Err(Status::Cancelled); 3])?;
    same(value(watcher.level.get_event_within(id, SHORT)), Err(Status::Timeout))?;
    over(watcher, id)
}

fn component_blocking_reaches_event_clients(watcher: &mut Watcher, _: &mut Context<'_>) -> Result<(), String> {
    let one = armed(watcher, Mode::Single, above(1.0))?;
    let two = text(watcher.heard.activate(Mode::Single, above(1.0)))?;
    watcher.blocking(false);
    let ends = [value(watcher.level.get_event(one)), value(watcher.heard.get_event(two))];
    watcher.blocking(true);
    same(ends, [Err(Status::Cancelled); 2])?;
    over(watcher, one)?;
    text(watcher.heard.deactivate(two))
}
