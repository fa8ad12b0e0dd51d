//! Tasks that a callback starts: noted where it runs, and started by its executor when it ends or waits. To start a thread
//! in the middle of a callback would be to do so on its stack and in its time.
#![allow(unsafe_code, reason = "address of unsafe: a job moves to the thread that runs it")]

use std::cell::{Cell, RefCell};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use component_sdk::abi::class::CallStatus;
use component_sdk::abi::task::{Phase, TaskApi, TaskDecl};
use component_sdk::status::Status;

use crate::model::limits::{DURATION_MAX, PERIOD_MIN, TASKS, WAIT_MAX};
use crate::model::text::Label;
use crate::model::time::nanoseconds;
use crate::sys::seat::{self, Note};
use crate::sys::{clock, crowd, fiber, trap};

/// What every plugin is given.
pub const API: TaskApi = TaskApi { spawn, cancelled, wait };

/// What a task does: plugin code, so to be entered on a fiber only. Not dropped by itself.
#[derive(Clone, Copy, Debug)]
pub struct Job {
    object: *mut (),
    call: extern "C" fn(job: *mut (), phase: Phase, now_ns: u64) -> CallStatus,
    drop: extern "C" fn(job: *mut ()) -> CallStatus,
}

// SAFETY: a job is `Send` (a supertrait of the SDK's `Job`), and the daemon enters it from one thread at a time.
unsafe impl Send for Job {}

impl Job {
    /// Enters a part of it.
    pub fn enter(&mut self, phase: Phase, now_ns: u64) -> CallStatus {
        (self.call)(self.object, phase, now_ns)
    }

    /// Drops it; the last use.
    pub fn destroy(&mut self) -> CallStatus {
        (self.drop)(self.object)
    }
}

/// A task that a callback started.
#[derive(Clone, Copy, Debug)]
pub struct Spawned {
    /// Its name.
    pub name: Label,
    /// Nanoseconds from one run to the next; `None`: it runs once.
    pub period_ns: Option<u64>,
    /// Time in which it must return, or wait, in nanoseconds; `None`: as callbacks.
    pub budget_ns: Option<u64>,
    /// What it does.
    pub job: Job,
}

thread_local! {
    static SPAWNED: [Cell<Option<Spawned>>; TASKS] = const { [const { Cell::new(None) }; TASKS] };
    static CANCELLED: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
}

/// A task that was started since the last call.
#[must_use]
#[inline(never)]
pub fn take_spawned() -> Option<Spawned> {
    let next = SPAWNED.with(|spawned| spawned.iter().find_map(Cell::take));
    if next.is_none() {
        seat::take(Note::Spawned);
    }
    next
}

/// What runs on this thread from now on is a task that is cancelled by that flag.
#[inline(never)]
pub fn set_current(cancelled: &Arc<AtomicBool>) {
    CANCELLED.set(Some(Arc::clone(cancelled)));
}

extern "C" fn spawn(task: TaskDecl<'_>) -> u32 {
    let period_ns = Some(task.period_ns).filter(|period_ns| *period_ns != 0);
    let spawned = Spawned {
        name: Label::new(task.name.as_str()),
        period_ns: period_ns.map(|ns| ns.clamp(nanoseconds(PERIOD_MIN), nanoseconds(DURATION_MAX))),
        budget_ns: Some(task.budget_ns.min(nanoseconds(DURATION_MAX))).filter(|budget_ns| *budget_ns != 0),
        job: Job { object: task.job, call: task.call, drop: task.drop },
    };
    let instance = seat::entered();
    if instance == 0 || seat::task().is_some() || !trap::on_fiber() {
        return Status::NotAllowed.code();
    }
    if !crowd::claim(instance) {
        return Status::Overload.code();
    }
    let place = |places: &[Cell<Option<Spawned>>; TASKS]| {
        let free = places.iter().find(|place| place.get().is_none())?;
        free.set(Some(spawned));
        Some(())
    };
    if SPAWNED.with(place).is_none() {
        crowd::release(instance);
        return Status::Overload.code();
    }
    seat::leave(Note::Spawned);
    0
}

extern "C" fn cancelled() -> bool {
    seat::task().is_some()
        && CANCELLED.with_borrow(|flag| flag.as_ref().is_some_and(|flag| flag.load(Ordering::Acquire)))
}

extern "C" fn wait(nanos: u64) -> bool {
    fiber::park(clock::now_ns().saturating_add(nanos.min(nanoseconds(WAIT_MAX)))).is_ok()
}
