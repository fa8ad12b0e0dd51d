//! The cases, each named after the line of the tables that it stands for.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use cases::{same, table, text};
use component_sdk::prelude::*;

use crate::more::{
    handlers_of_a_slot_run_one_at_a_time, no_method_panics_or_throws, queued_timed_handler,
    send_queued_by_a_task_is_fifo, trigger_input_prescale, wait_on_own_std_thread_is_refused,
    wait_while_panicking_is_cancelled,
};
use crate::{Tasker, todo};

crate::task_cases!(table Tasker;);

const SHORT: Duration = Duration::from_millis(20);

pub(crate) type Ended = Result<(), String>;

/// Waits until something is so; a busy machine takes its time.
pub(crate) fn until(cx: &Context<'_>, what: &str, so: impl Fn() -> bool) -> Ended {
    for _ in 0..10_000 {
        if so() {
            return Ok(());
        }
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    Err(format!("not so in time: {what}"))
}

pub(crate) fn spawn(
    cx: &Context<'_>,
    task: Task<'_>,
    run: impl FnMut(&mut Context<'_>) -> Outcome + Send + 'static,
) -> Result<(), String> {
    text(cx.spawn(task, run))
}

pub(crate) fn counter() -> (Arc<AtomicU64>, Arc<AtomicU64>) {
    let count = Arc::new(AtomicU64::new(0));
    (Arc::clone(&count), count)
}

pub(crate) fn ask(tasker: &mut Tasker, what: u64) -> Result<u64, String> {
    text(tasker.ask.query(what).map(|answer| *answer))
}

/// As [`ask`], of somebody who may be on the way to another instance.
fn ask_patiently(tasker: &mut Tasker, cx: &Context<'_>, what: u64) -> Result<u64, String> {
    for _ in 0..1_000 {
        match tasker.ask.query(what) {
            Ok(answer) => return Ok(*answer),
            Err(_) => _ = cx.sleep(Duration::from_millis(2)),
        }
    }
    Err("it does not answer any more".to_owned())
}

fn task_runs_stops_joins(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    // More often than there are places: each that has come to its end makes room.
    for round in 1..=40 {
        let (count, seen) = counter();
        let dropped = Arc::clone(&count);
        let run = move |_: &mut Context<'_>| -> Outcome {
            count.fetch_add(1, Ordering::SeqCst);
            Ok(())
        };
        let mut spawned = text(cx.spawn(Task::new("once"), run));
        for _ in 0..1_000 {
            if spawned.is_ok() {
                break;
            }
            same(cx.sleep(Duration::from_millis(1)), true)?;
            let count = Arc::clone(&dropped);
            let run = move |_: &mut Context<'_>| -> Outcome {
                count.fetch_add(1, Ordering::SeqCst);
                Ok(())
            };
            spawned = text(cx.spawn(Task::new("once"), run));
        }
        spawned.map_err(|why| format!("round {round}: {why}"))?;
        drop(dropped);
        until(cx, "it ran and was dropped", || Arc::strong_count(&seen) == 1)?;
        same(seen.load(Ordering::SeqCst), 1)?;
    }
    Ok(())
}

fn task_cancelled_flag(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (count, seen) = counter();
    spawn(cx, Task::new("asks"), move |cx: &mut Context<'_>| -> Outcome {
        count.store(1 + u64::from(cx.cancelled()), Ordering::SeqCst);
        Ok(())
    })?;
    until(cx, "it ran", || seen.load(Ordering::SeqCst) > 0)?;
    same((seen.load(Ordering::SeqCst), cx.cancelled()), (1, false))
}

fn task_sleep(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (count, seen) = counter();
    spawn(cx, Task::new("sleeps"), move |cx: &mut Context<'_>| -> Outcome {
        let began = cx.clock();
        let slept = cx.sleep(SHORT);
        count.store(cx.clock().since(began).as_nanos() as u64 * u64::from(slept), Ordering::SeqCst);
        Ok(())
    })?;
    until(cx, "it slept", || seen.load(Ordering::SeqCst) > 0)?;
    same(seen.load(Ordering::SeqCst) >= SHORT.as_nanos() as u64, true)
}

fn task_periodic_entry_execute_exit(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    struct Counts(Arc<Mutex<[u64; 3]>>);
    impl Job for Counts {
        fn enter(&mut self, _: &mut Context<'_>) -> Outcome {
            self.0.lock().map_err(|_| fault!("poisoned"))?[0] += 1;
            Ok(())
        }
        fn execute(&mut self, _: &mut Context<'_>) -> Outcome {
            self.0.lock().map_err(|_| fault!("poisoned"))?[1] += 1;
            Ok(())
        }
        fn exit(&mut self, _: &mut Context<'_>) -> Outcome {
            self.0.lock().map_err(|_| fault!("poisoned"))?[2] += 1;
            Ok(())
        }
    }
    let counts = Arc::new(Mutex::default());
    let read = || counts.lock().map_or([0; 3], |counts| *counts);
    text(cx.spawn_job(Task::new("once"), Counts(Arc::clone(&counts))))?;
    until(cx, "all three", || read()[2] > 0)?;
    same(read(), [1, 1, 1])?;
    text(cx.spawn_job(Task::new("often").period(Duration::from_millis(1)), Counts(Arc::clone(&counts))))?;
    until(cx, "often", || read()[1] >= 4)?;
    same((read()[0], read()[2]), (2, 1))
}

fn trigger_timed(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (count, seen) = counter();
    let began = cx.clock();
    spawn(cx, Task::new("ticks").period(Duration::from_millis(2)), move |_: &mut Context<'_>| -> Outcome {
        count.fetch_add(1, Ordering::SeqCst);
        Ok(())
    })?;
    until(cx, "ten periods", || seen.load(Ordering::SeqCst) >= 10)?;
    // Never more than there were periods; the first begins at once.
    let periods = cx.clock().since(began).as_nanos() as u64 / 2_000_000 + 1;
    same(seen.load(Ordering::SeqCst) <= periods, true)
}

fn trigger_query_queue(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let mut server = std::mem::take(&mut tasker.worked);
    let mut turn = 0;
    spawn(cx, Task::new("server"), move |cx: &mut Context<'_>| -> Outcome {
        while let Ok(query) = server.next(cx) {
            turn += 1;
            let number = *query;
            query.answer(number * 100 + turn)?;
        }
        Ok(())
    })?;
    same(tasker.own.query(5).map(|answer| *answer), Ok(501))
}

fn active_handler_is_one_worker_fifo(tasker: &mut Tasker, _: &mut Context<'_>) -> Ended {
    let ids: Vec<_> = (0..5).map(|number| tasker.own.request(number)).collect();
    for (number, id) in (0..5).zip(ids) {
        let answer = text(tasker.own.receive_wait(text(id)?).map(|answer| *answer))?;
        // One after the other, in the order in which they came.
        same(answer / 100, number)?;
    }
    Ok(())
}

fn a_task_that_could_answer_is_no_cycle(tasker: &mut Tasker, _: &mut Context<'_>) -> Ended {
    // The victim asks the tasker, who waits for it: a task answers.
    let answer = ask(tasker, todo::BACK)?;
    same(answer / 100, 40)
}

fn trigger_wait_cancelled_timeout_not_activated(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (mut beside, (count, seen)) = (std::mem::take(&mut tasker.beside), counter());
    spawn(cx, Task::new("waits"), move |cx: &mut Context<'_>| -> Outcome {
        let late = beside.query_within(todo::SLOW, Duration::from_millis(1)).err();
        beside.blocking(false)?;
        let refused = beside.query(todo::NUMBER).err();
        beside.blocking(true)?;
        let answered = beside.query(todo::NUMBER).is_ok();
        let good = (late, refused, answered) == (Some(Status::Timeout), Some(Status::Cancelled), true);
        count.store(1 + u64::from(good), Ordering::SeqCst);
        // For the next case.
        while !cx.cancelled() {
            if beside.query(todo::SLOW).is_ok_and(|answer| *answer == 7) {
                count.fetch_add(1, Ordering::SeqCst);
            }
        }
        Ok(())
    })?;
    until(cx, "it waited", || seen.load(Ordering::SeqCst) > 0)?;
    same(seen.load(Ordering::SeqCst) >= 2, true)
}

fn two_strands_wait_at_once(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    // The task of the case before asks on all the time.
    for _ in 0..5 {
        same(ask(tasker, todo::SLOW), Ok(7))?;
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    Ok(())
}

/// The processors that this thread may use.
fn processors() -> Result<String, String> {
    let status = std::fs::read_to_string("/proc/thread-self/status").map_err(|error| error.to_string())?;
    let line = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
    line.map(|list| list.trim().to_owned()).ok_or_else(|| "the kernel does not say".to_owned())
}

fn task_schedule_by_executor_rules(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (tells, told) = std::sync::mpsc::channel();
    spawn(cx, Task::new("tells"), move |_: &mut Context<'_>| -> Outcome {
        let _ = tells.send(processors());
        Ok(())
    })?;
    let mut task = None;
    for _ in 0..10_000 {
        task = task.or_else(|| told.try_recv().ok());
        if task.is_some() {
            break;
        }
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    // As the profile says of the executor.
    same((processors(), task), (Ok("0".to_owned()), Some(Ok("0".to_owned()))))
}

fn answer_later_from_a_task(tasker: &mut Tasker, _: &mut Context<'_>) -> Ended {
    (0..5).try_for_each(|_| same(ask(tasker, todo::BY_TASK), Ok(8)))
}

fn a_port_that_was_taken_is_closed(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    same(tasker.beside.query(1).err(), Some(Status::Closed))?;
    same(tasker.beside.request(1).err(), Some(Status::Closed))?;
    same(tasker.worked.try_next(cx).err(), Some(Status::Closed))
}

fn more_tasks_than_allowed_are_refused(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (count, seen) = counter();
    let spawn = |count: Arc<AtomicU64>| {
        cx.spawn(Task::new("one of many"), move |_: &mut Context<'_>| -> Outcome {
            count.fetch_add(1, Ordering::SeqCst);
            Ok(())
        })
    };
    let mut started = 0;
    let refused = loop {
        match spawn(Arc::clone(&count)) {
            Ok(()) if started < 16 => started += 1,
            end => break end,
        }
    };
    drop(count);
    same(refused, Err(Status::Overload))?;
    until(cx, "they came to their end", || Arc::strong_count(&seen) == 1)?;
    same((seen.load(Ordering::SeqCst), started > 5), (started, true))
}

fn a_task_starts_no_task(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (count, seen) = counter();
    spawn(cx, Task::new("tries"), move |cx: &mut Context<'_>| -> Outcome {
        let end = cx.spawn(Task::new("child"), |_: &mut Context<'_>| -> Outcome { Ok(()) });
        count.store(end.map_or_else(|status| u64::from(status.code()), |()| 1), Ordering::SeqCst);
        Ok(())
    })?;
    until(cx, "it tried", || seen.load(Ordering::SeqCst) > 0)?;
    same(seen.load(Ordering::SeqCst), u64::from(Status::NotAllowed.code()))
}

fn data_is_written_and_read_in_a_task(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (mut sent, mut heard) = (std::mem::take(&mut tasker.sent), std::mem::take(&mut tasker.heard));
    let (count, seen) = counter();
    spawn(cx, Task::new("writer"), move |cx: &mut Context<'_>| -> Outcome {
        for number in 1..=100 {
            sent.write(number);
            let _ = cx.sleep(Duration::from_micros(200));
        }
        Ok(())
    })?;
    spawn(cx, Task::new("reader"), move |cx: &mut Context<'_>| -> Outcome {
        while !cx.cancelled() {
            while let Some(number) = heard.take() {
                if *number > count.load(Ordering::SeqCst) {
                    count.store(*number, Ordering::SeqCst);
                }
            }
            let _ = cx.sleep(Duration::from_millis(1));
        }
        Ok(())
    })?;
    until(cx, "the last value came", || seen.load(Ordering::SeqCst) == 100)
}

/// The victim fails on a task, is reset, and the task is entered again.
fn fails_and_goes_on(tasker: &mut Tasker, cx: &Context<'_>, what: u64, tries: u64) -> Ended {
    let (number, resets) = (ask(tasker, todo::NUMBER)?, ask(tasker, todo::RESETS)?);
    ask(tasker, what)?;
    for _ in 0..2_000 {
        if ask(tasker, todo::RESETS)? > resets && ask(tasker, todo::TRIES)? >= tries {
            return same((ask(tasker, todo::NUMBER)?, ask(tasker, todo::RESETS)?), (number, resets + 1));
        }
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    Err(format!("resets: {resets} before, {} now; tries: {}", ask(tasker, todo::RESETS)?, ask(tasker, todo::TRIES)?))
}

fn task_error_is_its_slots_fault(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    fails_and_goes_on(tasker, cx, todo::ERROR, 2)
}

fn task_panic_is_its_slots_fault(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    fails_and_goes_on(tasker, cx, todo::PANIC, 2)
}

fn task_raises_a_fault(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    fails_and_goes_on(tasker, cx, todo::RAISE, 1)
}

/// The victim's next instance takes over, with tasks of its own.
fn is_replaced(tasker: &mut Tasker, cx: &Context<'_>, what: u64) -> Ended {
    let number = ask_patiently(tasker, cx, todo::NUMBER)?;
    let _ = tasker.ask.query(what);
    for _ in 0..2_000 {
        if ask_patiently(tasker, cx, todo::NUMBER)? > number {
            let ticks = ask_patiently(tasker, cx, todo::TICKS)?;
            for _ in 0..2_000 {
                if ask_patiently(tasker, cx, todo::TICKS)? > ticks {
                    return Ok(());
                }
                same(cx.sleep(Duration::from_millis(1)), true)?;
            }
            return Err("the successor's task does not run".to_owned());
        }
        same(cx.sleep(Duration::from_millis(1)), true)?;
    }
    Err(format!("it is still instance {number}"))
}

fn task_trap_is_its_slots_fault(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    (0..5).try_for_each(|_| is_replaced(tasker, cx, todo::TRAP))
}

fn task_trap_in_the_allocator_is_its_slots_fault(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    is_replaced(tasker, cx, todo::TRAP_IN_ALLOCATOR)
}

fn task_hang_is_its_slots_fault(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    is_replaced(tasker, cx, todo::HANG)
}

fn tasks_of_a_failed_callback_end_with_it(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    (0..5).try_for_each(|_| is_replaced(tasker, cx, todo::TRAP_IN_HANDLER))
}
