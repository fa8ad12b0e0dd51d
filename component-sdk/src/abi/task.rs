//! A component's tasks crossing the border: a closure as a pointer, and the shims that enter and drop it.
#![allow(unsafe_code, reason = "address of unsafe: a task crosses the border as a pointer")]

use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, catch_unwind};

use abi_stable::StableAbi;
use abi_stable::std_types::RStr;

use super::class::CallStatus;
use super::export::finish;
use super::host;
use crate::context::Context;
use crate::status::Status;
use crate::task::{Job, Task};

/// Which part of a task is entered.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Once, before the first run.
    Enter,
    /// Each period, or once.
    Execute,
    /// Once, after the last run.
    Exit,
}

/// A task, as the host gets it. The job is the host's from the moment in which it takes the task.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct TaskDecl<'a> {
    /// Name.
    pub name: RStr<'a>,
    /// Nanoseconds from one run to the next; 0: it runs once.
    pub period_ns: u64,
    /// Time in which it must return, or wait, in nanoseconds; 0: that of the component's callbacks.
    pub budget_ns: u64,
    /// What is to be done.
    pub job: *mut (),
    /// Enters it, with the monotonic time in nanoseconds.
    pub call: extern "C" fn(job: *mut (), phase: Phase, now_ns: u64) -> CallStatus,
    /// Drops it.
    pub drop: extern "C" fn(job: *mut ()) -> CallStatus,
}

/// What a plugin may call about tasks.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct TaskApi {
    /// Starts a task when this callback ends or waits; returns 0, or the code of a [`Status`], and the job is the caller's
    /// still.
    pub spawn: for<'a> extern "C" fn(task: TaskDecl<'a>) -> u32,
    /// The task that runs here is to come to its end.
    pub cancelled: extern "C" fn() -> bool,
    /// Waits at most that many nanoseconds, until something happens that anybody of the component could wait for; false:
    /// nobody may wait here. The body of a loop over a condition.
    pub wait: extern "C" fn(nanos: u64) -> bool,
}

impl TaskApi {
    /// Of a host that is not there.
    pub const CLOSED: Self = Self { spawn: closed_spawn, cancelled: closed_cancelled, wait: closed_wait };
}

extern "C" fn closed_spawn(_: TaskDecl<'_>) -> u32 {
    Status::Closed.code()
}

extern "C" fn closed_cancelled() -> bool {
    true
}

extern "C" fn closed_wait(_: u64) -> bool {
    false
}

/// Hands a task to the host.
pub(crate) fn spawn<J: Job>(task: &Task<'_>, job: J) -> Result<(), Status> {
    let job = Box::into_raw(Box::new(job)).cast::<()>();
    let decl = TaskDecl {
        name: RStr::from_str(task.name),
        period_ns: task.period_ns,
        budget_ns: task.budget_ns,
        job,
        call: Shims::<J>::call,
        drop: Shims::<J>::drop,
    };
    let taken = Status::check((host::get().tasks.spawn)(decl));
    if taken.is_err() {
        Shims::<J>::drop(job);
    }
    taken
}

struct Shims<J>(PhantomData<J>);

impl<J: Job> Shims<J> {
    extern "C" fn call(job: *mut (), phase: Phase, now_ns: u64) -> CallStatus {
        finish(catch_unwind(AssertUnwindSafe(|| {
            // SAFETY: the host passes what `spawn` made of this same type, one call at a time, and never again after `drop`
            // or after a trap.
            let job = unsafe { &mut *job.cast::<J>() };
            let cx = &mut Context::new(now_ns, host::get());
            match phase {
                Phase::Enter => job.enter(cx),
                Phase::Execute => job.execute(cx),
                Phase::Exit => job.exit(cx),
            }
        })))
    }

    extern "C" fn drop(job: *mut ()) -> CallStatus {
        finish(catch_unwind(AssertUnwindSafe(|| {
            // SAFETY: as in `call`; this is its last use.
            drop(unsafe { Box::from_raw(job.cast::<J>()) });
            Ok(())
        })))
    }
}
