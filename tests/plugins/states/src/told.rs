//! The cases, each named after the line of the tables that it stands for.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use cases::{same, table, text};
use component_sdk::prelude::*;

use crate::slave::HOLDS;
use crate::{Master, todo};

crate::state_cases!(table Master;);

const SHORT: Duration = Duration::from_millis(20);
const LONG: Duration = Duration::from_secs(60);

type Ended = Result<(), String>;

/// Waits until something is so; a busy machine takes its time.
fn until(cx: &Context<'_>, what: &str, mut so: impl FnMut() -> bool) -> Ended {
    for _ in 0..10_000 {
        if so() {
            return Ok(());
        }
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    Err(format!("not so in time: {what}"))
}

fn current(master: &mut Master) -> Result<String, String> {
    text(master.mine.current())
}

fn go(master: &mut Master, main: &str) -> Ended {
    text(master.mine.set_within(main, LONG))?;
    same(current(master)?.as_str(), main)
}

fn set_not_activated(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.mine.set("Moving"), Err(Status::NotActivated))
}

fn get_not_activated(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.mine.current(), Err(Status::NotActivated))?;
    same(master.mine.mains(), Err(Status::NotActivated))?;
    same(master.mine.subs("Neutral"), Err(Status::NotActivated))
}

fn acquire_not_activated(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.acquire("neutral").err(), Some(Status::NotActivated))?;
    same(master.own.try_acquire("neutral").err(), Some(Status::NotActivated))
}

fn define_states_creates_both(master: &mut Master, _: &mut Context<'_>) -> Ended {
    text(master.own.define("Moving", "drives"))?;
    text(master.own.define("Resting", "sleeps"))
}

fn substate_in_several_mains(master: &mut Master, _: &mut Context<'_>) -> Ended {
    text(master.own.define("Moving", "looks"))?;
    text(master.own.define("Looking", "looks"))?;
    text(master.own.define("Looking", "turns"))
}

fn define_reserved_name(master: &mut Master, _: &mut Context<'_>) -> Ended {
    for (main, sub) in [("Neutral", "x"), ("Deactivated", "x"), ("Shutdown", "x"), ("Moving", "nonneutral")] {
        same(master.own.define(main, sub), Err(Status::NotAllowed))?;
    }
    Ok(())
}

fn initial_unknown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.initial("Flying"), Err(Status::Error))
}

fn activate_enables_use(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    text(master.own.initial("Resting"))?;
    let told = Arc::clone(&master.told);
    master.own.on_change(move |_, edge| {
        let line = match edge {
            Edge::Quit(sub) => format!("-{sub}"),
            Edge::Enter(sub) => format!("+{sub}"),
        };
        told.lock().map_err(|_| fault!("poisoned"))?.push(line);
        Ok(())
    });
    text(master.own.activate())?;
    same(master.own.activate(), Err(Status::NotAllowed))?;
    until(cx, "it is alive", || master.mine.current().is_ok())
}

fn initial_state(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(current(master)?.as_str(), "Resting")?;
    text(master.own.acquire("sleeps")).map(drop)
}

fn define_after_activate(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.define("Late", "x"), Err(Status::Activated))?;
    same(master.own.initial("Moving"), Err(Status::Activated))
}

fn get_current_mains_subs(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let mains = text(master.mine.mains())?;
    same(mains, ["Neutral", "Moving", "Resting", "Looking"].map(str::to_owned).to_vec())?;
    same(current(master)?.as_str(), "Resting")
}

fn get_unknown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.mine.subs("Flying"), Err(Status::UnknownState))
}

fn user_mains_contain_nonneutral(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(text(master.mine.subs("Moving"))?, ["nonneutral", "drives", "looks"].map(str::to_owned).to_vec())?;
    same(text(master.mine.subs("Neutral"))?, vec!["neutral".to_owned()])
}

fn set_waits_until_done(master: &mut Master, _: &mut Context<'_>) -> Ended {
    go(master, "Moving")?;
    text(master.own.try_acquire("drives")).map(drop)?;
    // There already.
    go(master, "Moving")
}

fn set_unknown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.mine.set("Flying"), Err(Status::UnknownState))
}

fn set_life_cycle_not_allowed(master: &mut Master, _: &mut Context<'_>) -> Ended {
    ["Init", "Alive", "Shutdown", "FatalError"]
        .iter()
        .try_for_each(|name| same(master.mine.set(name), Err(Status::NotAllowed)))
}

fn set_unconnected(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.loose.set("Moving"), Err(Status::Disconnected))?;
    same(master.loose.current(), Err(Status::Disconnected))
}

fn acquire_active_counts(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let (one, two) = (text(master.own.acquire("drives"))?, text(master.own.acquire("drives"))?);
    drop(one);
    same(master.mine.set_within("Resting", SHORT), Err(Status::Timeout))?;
    drop(two);
    go(master, "Resting")?;
    go(master, "Moving")
}

fn acquire_unknown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.acquire("flies").err(), Some(Status::UnknownState))
}

fn try_acquire_ok(master: &mut Master, _: &mut Context<'_>) -> Ended {
    text(master.own.try_acquire("looks")).map(drop)
}

fn try_acquire_inactive(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.try_acquire("turns").err(), Some(Status::NotActivated))
}

fn try_acquire_unknown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.try_acquire("flies").err(), Some(Status::UnknownState))
}

fn release_too_often_ignored(master: &mut Master, _: &mut Context<'_>) -> Ended {
    (0..3).try_for_each(|_| text(master.own.release("drives")))?;
    // It holds all the same.
    let held = text(master.own.acquire("drives"))?;
    same(master.mine.set_within("Resting", SHORT), Err(Status::Timeout))?;
    drop(held);
    go(master, "Resting")?;
    go(master, "Moving")
}

fn release_unknown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.release("flies"), Err(Status::UnknownState))
}

fn held_is_released_on_drop(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let held = text(master.own.acquire("drives"))?;
    drop(held);
    go(master, "Resting")?;
    go(master, "Moving")?;
    text(master.own.acquire("drives"))?.keep();
    same(master.mine.set_within("Resting", SHORT), Err(Status::Timeout))?;
    text(master.own.release("drives"))?;
    go(master, "Resting")?;
    go(master, "Moving")
}

fn try_acquire_pending(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let held = text(master.own.acquire("drives"))?;
    same(master.mine.set_within("Resting", SHORT), Err(Status::Timeout))?;
    same(master.own.try_acquire("drives").err(), Some(Status::NotActivated))?;
    same(master.own.try_acquire("sleeps").err(), Some(Status::NotActivated))?;
    drop(held);
    go(master, "Moving")
}

/// Runs beside; its result is 0 until it is there.
fn beside(
    cx: &Context<'_>,
    mut run: impl FnMut() -> Result<(), Status> + Send + 'static,
) -> Result<Box<dyn Fn() -> u32>, String> {
    let result = Arc::new(AtomicU32::new(0));
    let seen = Arc::clone(&result);
    text(cx.spawn(Task::new("beside"), move |_: &mut Context<'_>| -> Outcome {
        result.store(run().map_or_else(Status::code, |()| u32::MAX), Ordering::SeqCst);
        Ok(())
    }))?;
    Ok(Box::new(move || seen.load(Ordering::SeqCst)))
}

fn acquire_waits_for_a_pending_change(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    let substates = master.own.substates();
    let end = beside(cx, move || substates.acquire("sleeps").map(drop))?;
    same(cx.sleep(SHORT), true)?;
    same(end(), 0)?;
    go(master, "Resting")?;
    until(cx, "it holds", || end() == u32::MAX)?;
    // The component's own callback waits as well.
    let (mut second, substates) = (std::mem::take(&mut master.second), master.own.substates());
    let end = beside(cx, move || {
        let held = substates.acquire("sleeps")?;
        let late = second.set_within("Moving", SHORT);
        drop(held);
        if late == Err(Status::Timeout) { Ok(()) } else { Err(Status::Error) }
    })?;
    drop(text(master.own.acquire("drives"))?);
    until(cx, "it let go", || end() != 0)?;
    same(end(), u32::MAX)
}

fn release_reevaluates(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    let held = text(master.own.acquire("drives"))?;
    same(master.mine.set_within("Looking", SHORT), Err(Status::Timeout))?;
    same(current(master)?.as_str(), "Moving")?;
    drop(held);
    until(cx, "the change is done", || current(master).is_ok_and(|name| name == "Looking"))
}

fn change_waits_for_holders(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    go(master, "Moving")?;
    let substates = master.own.substates();
    let held = text(substates.acquire("drives"))?;
    let mut held = Some(held);
    let clock = cx.clock();
    text(cx.spawn(Task::new("holder"), move |cx: &mut Context<'_>| -> Outcome {
        let _ = cx.sleep(SHORT);
        drop(held.take());
        Ok(())
    }))?;
    go(master, "Looking")?;
    same(cx.clock().since(clock) >= SHORT, true)
}

fn shared_substates_keep_running(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let held = text(master.own.acquire("looks"))?;
    go(master, "Moving")?;
    go(master, "Looking")?;
    drop(held);
    Ok(())
}

fn take_told(master: &Master) -> Result<Vec<String>, String> {
    master.told.lock().map(|mut told| std::mem::take(&mut *told)).map_err(|_| "poisoned".to_owned())
}

fn order_quit_enter_wake_answer(master: &mut Master, _: &mut Context<'_>) -> Ended {
    go(master, "Neutral")?;
    take_told(master)?;
    go(master, "Moving")?;
    // Answered when all of them have been told.
    same(take_told(master)?, ["-neutral", "+nonneutral", "+drives", "+looks"].map(str::to_owned).to_vec())?;
    go(master, "Neutral")?;
    same(take_told(master)?, ["-drives", "-looks", "-nonneutral", "+neutral"].map(str::to_owned).to_vec())
}

fn quit_and_enter_handlers_per_substate(master: &mut Master, _: &mut Context<'_>) -> Ended {
    go(master, "Moving")?;
    take_told(master)?;
    go(master, "Looking")?;
    same(take_told(master)?, ["-drives", "+turns"].map(str::to_owned).to_vec())
}

fn second_set_while_pending_is_answered(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    let mut held = Some(text(master.own.acquire("turns"))?);
    let mut slave = std::mem::take(&mut master.loose);
    // Nobody is at the other end of that one: it only shows that a task's end does not matter.
    let idle = beside(cx, move || slave.set("Moving"))?;
    text(cx.spawn(Task::new("holder"), move |cx: &mut Context<'_>| -> Outcome {
        let _ = cx.sleep(SHORT);
        drop(held.take());
        Ok(())
    }))?;
    same(master.mine.set_within("Moving", Duration::from_millis(1)), Err(Status::Timeout))?;
    text(master.mine.set_within("Resting", LONG))?;
    same(current(master)?.as_str(), "Resting")?;
    until(cx, "the other is told", || idle() == Status::Disconnected.code())
}

fn get_never_cancelled_by_neutral(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let held = text(master.own.acquire("sleeps"))?;
    same(master.mine.set_within("Neutral", SHORT), Err(Status::Timeout))?;
    same(current(master)?.as_str(), "Resting")?;
    text(master.mine.mains())?;
    drop(held);
    go(master, "Resting")
}

fn set_cancelled_blocking_off(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let held = text(master.own.acquire("sleeps"))?;
    text(master.mine.blocking(false))?;
    let end = master.mine.set("Neutral");
    text(master.mine.blocking(true))?;
    drop(held);
    same(end, Err(Status::Cancelled))?;
    go(master, "Resting")
}

fn neutral_reserved(master: &mut Master, _: &mut Context<'_>) -> Ended {
    go(master, "Neutral")?;
    text(master.own.acquire("neutral")).map(drop)
}

fn reserved_substates(master: &mut Master, _: &mut Context<'_>) -> Ended {
    for name in ["nonneutral", "init", "fatalError", "shutdown"] {
        same(master.own.try_acquire(name).err(), Some(Status::NotActivated))?;
    }
    go(master, "Moving")?;
    text(master.own.acquire("nonneutral")).map(drop)
}

fn a_handler_fails(master: &mut Master, _: &mut Context<'_>) -> Ended {
    let mut first = true;
    let told = Arc::clone(&master.told);
    master.own.on_change(move |_, edge| {
        told.lock().map_err(|_| fault!("poisoned"))?.push(format!("{edge:?}"));
        if std::mem::take(&mut first) { Err(fault!("the handler cannot")) } else { Ok(()) }
    });
    // A fault of the own slot ends its waits, if the answer is not there before: the callback comes to its end.
    let end = master.mine.set_within("Neutral", LONG);
    same(matches!(end, Ok(()) | Err(Status::Cancelled)), true)
}

fn handler_fault_is_its_slots_fault_and_the_change_is_done(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    until(cx, "the change is done", || current(master).is_ok_and(|name| name == "Neutral"))?;
    take_told(master)?;
    // It is still the handler.
    go(master, "Moving")?;
    same(take_told(master)?.is_empty(), false)
}

fn slave_set_life_cycle_only(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.life(Life::Init), Err(Status::NotAllowed))?;
    same(master.own.life(Life::Alive), Err(Status::NotAllowed))
}

fn shutdown_jumps_the_queue(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    go(master, "Moving")?;
    let held = text(master.own.try_acquire("drives"))?;
    let substates = master.own.substates();
    let waits = beside(cx, move || substates.acquire("turns").map(drop))?;
    same(master.mine.set_within("Looking", SHORT), Err(Status::Timeout))?;
    text(master.own.life(Life::Shutdown))?;
    same(master.mine.set_within("Moving", LONG), Err(Status::Cancelled))?;
    drop(held);
    until(cx, "it is shut down", || current(master).is_ok_and(|name| name == "Shutdown"))?;
    until(cx, "who waited is told", || waits() == Status::NotActivated.code())
}

fn set_cancelled_in_shutdown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.mine.set("Moving"), Err(Status::Cancelled))
}

fn acquire_after_shutdown(master: &mut Master, _: &mut Context<'_>) -> Ended {
    same(master.own.acquire("drives").err(), Some(Status::NotActivated))?;
    same(master.own.try_acquire("shutdown").err(), Some(Status::NotActivated))
}

/// The slave's state, as soon as it answers again.
fn patiently(master: &mut Master, cx: &Context<'_>, main: &str) -> Ended {
    until(cx, main, || master.slave.set_within(main, LONG).is_ok())
}

/// Has the slave hold its substate.
fn holding(master: &mut Master, cx: &Context<'_>, what: u64) -> Result<component_sdk::port::QueryId<u64>, String> {
    HOLDS.store(false, Ordering::SeqCst);
    let id = text(master.ask.request(what))?;
    until(cx, "it holds", || HOLDS.load(Ordering::SeqCst))?;
    Ok(id)
}

fn deactivated_rushes_through_blocking_calls(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    patiently(master, cx, "Moving")?;
    let id = holding(master, cx, todo::HOLD_AND_ASK)?;
    same(master.slave.set_within("Looking", SHORT), Err(Status::Timeout))?;
    text(master.slave.set_within("Deactivated", LONG))?;
    let end = text(master.ask.receive_wait_within(id, LONG).map(|answer| *answer))?;
    same(end, u64::from(Status::Cancelled.code()))?;
    // What was asked for before has its turn afterwards.
    until(cx, "it looks", || master.slave.current().is_ok_and(|name| name == "Looking"))?;
    text(master.slave.set_within("Deactivated", LONG))?;
    same(text(master.slave.current())?.as_str(), "Neutral")?;
    // It may wait again.
    let end = text(master.ask.query_within(todo::ASK, LONG).map(|answer| *answer))?;
    same(end, u64::from(Status::Timeout.code()))
}

fn fails_while_it_holds(master: &mut Master, cx: &Context<'_>, what: u64) -> Ended {
    patiently(master, cx, "Moving")?;
    let end = master.ask.query_within(what, LONG).err();
    same(end.is_some(), true)?;
    // Nothing stays held.
    patiently(master, cx, "Looking")
}

fn held_is_released_when_its_callback_panics(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    fails_while_it_holds(master, cx, todo::HOLD_AND_PANIC)
}

fn held_is_released_when_its_callback_traps(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    (0..3).try_for_each(|_| fails_while_it_holds(master, cx, todo::HOLD_AND_TRAP))
}

fn master_of_a_slave_that_fails_is_told(master: &mut Master, cx: &mut Context<'_>) -> Ended {
    patiently(master, cx, "Moving")?;
    let id = holding(master, cx, todo::HOLD_AND_TRAP_LATER)?;
    same(master.slave.set_within("Neutral", LONG), Err(Status::ProviderGone))?;
    same(master.ask.receive_wait_within(id, LONG).err(), Some(Status::ProviderGone))?;
    patiently(master, cx, "Moving")
}
