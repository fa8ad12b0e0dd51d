//! The one that fails, on its tasks.

use std::hint::black_box;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use component_sdk::prelude::*;

use crate::todo;

static INSTANCES: AtomicU64 = AtomicU64::new(0);
static RESETS: AtomicU64 = AtomicU64::new(0);
static TICKS: AtomicU64 = AtomicU64::new(0);
static INSIDE: AtomicU64 = AtomicU64::new(0);
static MOST_INSIDE: AtomicU64 = AtomicU64::new(0);
static TRIES: AtomicU64 = AtomicU64::new(0);

/// Does what it is asked to.
#[derive(Component)]
#[component(name = "Victim", version = "1.0", passive)]
pub struct Victim {
    #[port(handler = on_ask)]
    asked: QueryServer<u64, u64>,
    /// To the tasker, whose task answers.
    #[port]
    back: QueryClient<u64, u64>,
    /// Its handler leaves the work of each cycle to a task, and puts what that has made.
    #[port(timed = "5ms", started, handler = on_tick)]
    timed: PushTimedServer<u64>,
    number: u64,
    /// For the task.
    by_task: Arc<Mutex<Vec<Pending<u64, u64>>>>,
    /// Cycles, for the task, and the one that it has made a value of.
    cycles: Arc<AtomicU64>,
    made: Arc<AtomicU64>,
}

impl Callbacks for Victim {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.number = INSTANCES.fetch_add(1, Ordering::SeqCst) + 1;
        let by_task = Arc::clone(&self.by_task);
        let (cycles, made) = (Arc::clone(&self.cycles), Arc::clone(&self.made));
        cx.spawn(Task::new("ticker").period(Duration::from_millis(1)), move |_: &mut Context<'_>| -> Outcome {
            TICKS.fetch_add(1, Ordering::SeqCst);
            made.store(cycles.load(Ordering::SeqCst), Ordering::SeqCst);
            let pending = std::mem::take(&mut *by_task.lock().map_err(|_| fault!("poisoned"))?);
            pending.into_iter().try_for_each(|pending| pending.answer(8))?;
            Ok(())
        })?;
        Ok(())
    }

    fn reset(&mut self, _: &mut Context<'_>) -> Outcome {
        RESETS.fetch_add(1, Ordering::SeqCst);
        Ok(())
    }
}

impl Victim {
    fn on_ask(&mut self, cx: &mut Context<'_>, query: Query<'_, u64, u64>) -> Outcome {
        let answer = match *query {
            todo::BY_TASK => {
                self.by_task.lock().map_err(|_| fault!("poisoned"))?.push(query.keep());
                return Ok(());
            }
            todo::MOST_INSIDE => MOST_INSIDE.load(Ordering::SeqCst),
            todo::RESETS => RESETS.load(Ordering::SeqCst),
            todo::TICKS => TICKS.load(Ordering::SeqCst),
            todo::TRIES => TRIES.load(Ordering::SeqCst),
            todo::BACK => self.back.query(40).map_or_else(|status| u64::from(status.code()), |answer| *answer),
            todo::TRAP_IN_HANDLER => {
                trap();
                0
            }
            todo::SLOW => {
                MOST_INSIDE.fetch_max(INSIDE.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                let _ = cx.sleep(Duration::from_millis(20));
                INSIDE.fetch_sub(1, Ordering::SeqCst);
                7
            }
            todo::NUMBER => self.number,
            what => {
                TRIES.store(0, Ordering::SeqCst);
                cx.spawn(Task::new("fails"), move |cx: &mut Context<'_>| fail(what, cx))?;
                self.number
            }
        };
        query.answer(answer)?;
        Ok(())
    }
}

impl Victim {
    fn on_tick(&mut self, _: &mut Context<'_>) -> Outcome {
        self.cycles.fetch_add(1, Ordering::SeqCst);
        self.timed.put(self.made.load(Ordering::SeqCst))?;
        Ok(())
    }
}

/// Fails the first time.
fn fail(what: u64, cx: &Context<'_>) -> Outcome {
    if TRIES.fetch_add(1, Ordering::SeqCst) > 0 {
        return Ok(());
    }
    // Into the middle of a wait of its neighbour.
    let _ = cx.sleep(Duration::from_millis(5));
    match what {
        todo::ERROR => return Err(fault!("the task cannot")),
        todo::PANIC => panic!("the task was asked to"),
        todo::RAISE => cx.raise_fault("the task does not like it"),
        todo::TRAP => trap(),
        todo::TRAP_IN_ALLOCATOR => trap_in_allocator(),
        todo::HANG => hang(),
        _ => {}
    }
    Ok(())
}

#[allow(unsafe_code, reason = "the write faults, which is its purpose")]
fn trap() {
    // SAFETY: none.
    unsafe { black_box(8 as *mut u32).write_volatile(1) };
}

#[allow(unsafe_code, reason = "the allocator meets a wild pointer, which is its purpose")]
fn trap_in_allocator() {
    // SAFETY: none.
    unsafe { std::alloc::dealloc(black_box(0x0dea_dbee_f000 as *mut u8), std::alloc::Layout::new::<[u64; 64]>()) };
}

pub(crate) fn hang() {
    let mut turns = 0u64;
    while black_box(turns) < u64::MAX {
        turns = turns.wrapping_add(1);
    }
}
