//! Further cases: ports that a task serves, and waits from where nobody may wait.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use cases::{same, text};
use component_sdk::port::{PushTimedServer, SendServer};
use component_sdk::prelude::*;

use crate::told::{Ended, ask, counter, spawn, until};
use crate::{Tasker, todo};

const LONG: Duration = Duration::from_secs(30);

type Client = QueryClient<u64, u64>;

fn number(told: Result<component_sdk::port::Reply<'_, u64>, Status>) -> Result<u64, Status> {
    told.map(|told| *told)
}

pub(crate) fn handlers_of_a_slot_run_one_at_a_time(tasker: &mut Tasker, _: &mut Context<'_>) -> Ended {
    // Each waits in its handler for a while.
    let mut ids = Vec::new();
    for _ in 0..3 {
        ids.push((text(tasker.ask.request(todo::SLOW))?, text(tasker.third.request(todo::SLOW))?));
    }
    for (one, other) in ids {
        same(number(tasker.ask.receive_wait_within(one, LONG)), Ok(7))?;
        same(number(tasker.third.receive_wait_within(other, LONG)), Ok(7))?;
    }
    same(ask(tasker, todo::MOST_INSIDE)?, 1)
}

pub(crate) fn trigger_input_prescale(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let (mut fed, seen) = (std::mem::take(&mut tasker.fed), Arc::new(Mutex::new(Vec::new())));
    text(fed.subscribe(3))?;
    let values = Arc::clone(&seen);
    spawn(cx, Task::new("listens"), move |_: &mut Context<'_>| -> Outcome {
        for _ in 0..4 {
            let value = *fed.update_wait_within(LONG)?;
            values.lock().map_err(|_| fault!("poisoned"))?.push(value);
        }
        Ok(())
    })?;
    let read = || seen.lock().map_or_else(|_| Vec::new(), |values| values.clone());
    // A wait is for what comes after it has begun: whichever of the thirds these are.
    for value in 1..10_000 {
        text(tasker.feed.put(value).map(drop))?;
        same(cx.sleep(Duration::from_millis(1)), true)?;
        if read().len() == 4 {
            break;
        }
    }
    let values = read();
    same((values.len(), values.iter().find(|value| *value % 3 != 1)), (4, None))?;
    same(values.is_sorted(), true)
}

pub(crate) fn send_queued_by_a_task_is_fifo(tasker: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    const COUNT: u64 = 100;
    let (mut queued, seen) = (std::mem::take(&mut tasker.queued), Arc::new(Mutex::new(Vec::new())));
    let numbers = Arc::clone(&seen);
    spawn(cx, Task::new("worker"), move |cx: &mut Context<'_>| -> Outcome {
        for _ in 0..COUNT {
            let number = *queued.next_within(cx, LONG)?;
            numbers.lock().map_err(|_| fault!("poisoned"))?.push(number);
            // Slower than who sends.
            let _ = cx.sleep(Duration::from_micros(100));
        }
        Ok(())
    })?;
    for number in 0..COUNT {
        while tasker.orders.send(number) == Err(Status::Overload) {
            same(cx.sleep(Duration::from_millis(1)), true)?;
        }
    }
    let read = || seen.lock().map_or_else(|_| Vec::new(), |numbers| numbers.clone());
    until(cx, "all were served", || read().len() as u64 == COUNT)?;
    same(read(), (0..COUNT).collect())
}

pub(crate) fn queued_timed_handler(tasker: &mut Tasker, _: &mut Context<'_>) -> Ended {
    text(tasker.clock.subscribe(1))?;
    let (mut values, began) = (Vec::new(), std::time::Instant::now());
    // What the task makes comes with one of the next cycles.
    while values.last().is_none_or(|last| last - values[0] < 5) && began.elapsed() < LONG {
        values.push(*text(tasker.clock.update_wait_within(LONG))?);
    }
    same((values.is_sorted(), values.last().is_some_and(|last| last - values[0] >= 5)), (true, true))?;
    text(tasker.clock.unsubscribe())
}

pub(crate) fn wait_on_own_std_thread_is_refused(tasker: &mut Tasker, _: &mut Context<'_>) -> Ended {
    let mut port = std::mem::take(&mut tasker.third);
    let thread = std::thread::spawn(move || {
        let end = number(port.query(todo::NUMBER)).err();
        (port, end)
    });
    let (port, end) = thread.join().map_err(|_| "it panicked")?;
    tasker.third = port;
    same(end == Some(Status::NotAllowed) || end == Some(Status::Cancelled), true)?;
    same(number(tasker.third.query(todo::NUMBER)).is_ok(), true)
}

/// Asks when it is dropped.
struct LastQuestion<'a>(&'a mut Client, &'a AtomicU64);

impl Drop for LastQuestion<'_> {
    fn drop(&mut self) {
        let end = number(self.0.query(todo::NUMBER));
        self.1.store(end.map_or_else(|status| u64::from(status.code()), |_| 0), Ordering::SeqCst);
    }
}

pub(crate) fn wait_while_panicking_is_cancelled(tasker: &mut Tasker, _: &mut Context<'_>) -> Ended {
    let (end, _) = counter();
    drop(LastQuestion(&mut tasker.third, &end));
    same(end.load(Ordering::SeqCst), 0)?;
    let unwound = catch_unwind(AssertUnwindSafe(|| {
        let _question = LastQuestion(&mut tasker.third, &end);
        panic!("on purpose");
    }));
    same((unwound.is_err(), end.load(Ordering::SeqCst)), (true, u64::from(Status::Cancelled.code())))?;
    same(number(tasker.third.query(todo::NUMBER)).is_ok(), true)
}

pub(crate) fn no_method_panics_or_throws(_: &mut Tasker, cx: &mut Context<'_>) -> Ended {
    let closed = Err(Status::Closed);
    let mut client = Client::default();
    same(number(client.query(1)), Err(Status::Closed))?;
    same([client.request(1).map(drop), client.blocking(false)], [closed; 2])?;
    let mut server = QueryServer::<u64, u64>::default();
    same([server.try_next(cx).map(drop), server.next_within(cx, LONG).map(drop)], [closed; 2])?;
    let (mut client, mut server) = (SendClient::<u64>::default(), SendServer::<u64>::default());
    same([client.send(1), client.blocking(false), server.try_next(cx).map(drop)], [closed; 3])?;
    let (mut put, mut timed) = (PushServer::<u64>::default(), PushTimedServer::<u64>::default());
    same([put.put(1).map(drop), timed.put(1).map(drop), timed.start(), timed.stop()], [closed; 4])?;
    let mut client = PushClient::<u64>::default();
    same([client.subscribe(1), client.unsubscribe(), client.blocking(false)], [closed; 3])?;
    same([client.update().map(drop), client.update_wait().map(drop), client.server_info().map(drop)], [closed; 3])?;
    let mut client = EventClient::<u64, u64>::default();
    same([client.activate(Mode::Single, 1).map(drop), client.blocking(false)], [closed; 2])?;
    let (mut reader, mut writer) = (DataIn::<u64>::default(), DataOut::<u64>::default());
    same((reader.take().copied(), reader.newest().copied(), writer.write(1)), (None, None, Sent::Closed))
}
