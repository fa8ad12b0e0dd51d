//! Tasks: threads of a component's own, for what takes longer than a callback may.
//!
//! ```
//! use component_sdk::prelude::*;
//! use std::time::Duration;
//!
//! /// Draws a map, beside its callbacks.
//! #[derive(Component)]
//! #[component(name = "Mapper", passive)]
//! pub struct Mapper {
//!     #[port]
//!     scan: QueryClient<u64, LaserScan>,
//! }
//!
//! impl Callbacks for Mapper {
//!     fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
//!         let mut scan = std::mem::take(&mut self.scan);
//!         let mut seen = 0;
//!         cx.spawn(Task::new("mapper").period(Duration::from_millis(100)), move |_: &mut Context<'_>| -> Outcome {
//!             seen += scan.query(180)?.ranges.len();
//!             Ok(())
//!         })?;
//!         Ok(())
//!     }
//! }
//! ```
//!
//! What the task uses is moved into it: a port that was taken leaves a closed one behind. So a port has one user, which the
//! compiler sees to, and nobody needs a lock. Handlers are the component's own: none is entered for a port that was taken. A
//! server whose handler has much to do keeps its port, and leaves the work to a task.
//!
//! A task may wait, as `on_execute` may; what it does between two waits must take no longer than a callback may
//! ([`Task::budget`](crate::task::Task::budget) says otherwise). Whatever ends it but its own return is a fault of its component: after a trap or a
//! hang the instance is replaced with all of its tasks, and its successor starts its own in `start`; after a panic or
//! an error it runs again when the component was reset. What was moved into a task does not come back: when a slot that was
//! stopped starts again, an instance that had tasks is replaced by a fresh one, whose `start` has its ports.

use std::time::Duration;

use crate::abi::task;
use crate::component::Outcome;
use crate::context::Context;
use crate::status::Status;

/// A task: its name, and when it runs.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    pub(crate) name: &'a str,
    pub(crate) period_ns: u64,
    pub(crate) budget_ns: u64,
}

impl<'a> Task<'a> {
    /// One that runs once.
    #[must_use]
    pub const fn new(name: &'a str) -> Self {
        Self { name, period_ns: 0, budget_ns: 0 }
    }

    /// Runs each period, at least 50 microseconds long. A period that begins while it still runs is left out.
    #[must_use]
    pub fn period(self, period: Duration) -> Self {
        Self { period_ns: nanos(period).max(1), ..self }
    }

    /// Must return, or wait, within that time; without it, within the time of the component's callbacks.
    #[must_use]
    pub fn budget(self, budget: Duration) -> Self {
        Self { budget_ns: nanos(budget).max(1), ..self }
    }
}

fn nanos(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

/// What a task does, where it also has something to do before its first run or after its last.
pub trait Job: Send + 'static {
    /// Once, before the first run.
    ///
    /// # Errors
    /// A fault of the component.
    fn enter(&mut self, _cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }

    /// Each period, or once.
    ///
    /// # Errors
    /// A fault of the component.
    fn execute(&mut self, cx: &mut Context<'_>) -> Outcome;

    /// Once, after the last run, or when the task is cancelled; not after a trap.
    ///
    /// # Errors
    /// A fault of the component.
    fn exit(&mut self, _cx: &mut Context<'_>) -> Outcome {
        Ok(())
    }
}

/// A closure as a job.
struct Runs<F>(F);

impl<F: FnMut(&mut Context<'_>) -> Outcome + Send + 'static> Job for Runs<F> {
    fn execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        (self.0)(cx)
    }
}

impl Context<'_> {
    /// Starts a task, in `start`, `on_execute` or a handler: it runs on a thread of its own as soon as this callback ends or
    /// waits. It is cancelled when the component is to stop or its instance leaves the slot.
    ///
    /// # Errors
    /// `Overload`: the component has 16 already; `NotAllowed`: not from here; `Closed`.
    pub fn spawn(
        &self,
        task: Task<'_>,
        run: impl FnMut(&mut Context<'_>) -> Outcome + Send + 'static,
    ) -> Result<(), Status> {
        self.spawn_job(task, Runs(run))
    }

    /// As [`Self::spawn`], with something to do before the first run and after the last.
    ///
    /// # Errors
    /// As [`Self::spawn`].
    pub fn spawn_job(&self, task: Task<'_>, job: impl Job) -> Result<(), Status> {
        task::spawn(&task, job)
    }

    /// True in a task that is to come to its end: from now on it waits for nothing, and has a fraction of a second.
    #[must_use]
    pub fn cancelled(&self) -> bool {
        (self.host().tasks.cancelled)()
    }
}
