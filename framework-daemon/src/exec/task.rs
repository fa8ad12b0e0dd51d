//! Tasks of a slot, as its executor sees them: started after the callback that asked for them, ended before another instance
//! takes the slot over, and answered for by the slot's rules.
//!
//! | state | who runs | next |
//! |---|---|---|
//! | `Resting` | nobody: before the first run, between two, after a fault | `Running`, `Gone` |
//! | `Running` | the component's code, on a fiber of the task's thread | `Parked`, `Resting` |
//! | `Parked` | nobody: the fiber waits | `Running`, `Gone` |
//! | `Gone` | nobody ever again | |
//!
//! The executor takes a task away in the states in which no code of it runs, by one exchange; one that runs is cut short by
//! the watchdog. So an instance never shares its slot's ports with tasks of the one before.
//!
//! More members on the slot's executor were the alternative: a task that computes would block it.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use crossbeam_queue::ArrayQueue;

use super::task_run::{self, Run};
use super::unit::Limits;
use crate::model::fault::Fault;
use crate::model::limits::{TASK_END_BY_FORCE, TASKS};
use crate::model::schedule::Schedule;
use crate::model::text::Label;
use crate::model::time::nanoseconds;
use crate::plugin::instance;
use crate::plugin::task::Spawned;
use crate::port::wait::Waiter;
use crate::sys::bell::{Ring, Signal};
use crate::sys::pulse::Pulse;
use crate::sys::wake::Waker;
use crate::sys::{clock, crowd, watchdog};

/// Whose code runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum State {
    Resting,
    Running,
    Parked,
    Gone,
}

/// What a task that failed is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Verdict {
    /// Nobody has said yet.
    None,
    /// It goes on.
    Again,
    /// It is over.
    Over,
}

/// A task.
pub struct Task {
    /// Its name.
    pub name: Label,
    /// Nanoseconds from one run to the next; `None`: it runs once.
    pub period_ns: Option<u64>,
    /// Its number: no instance and no other task ever has the same.
    pub(super) number: u64,
    /// The instance whose it is.
    pub(super) instance: u64,
    /// Its place in the slot's crowd.
    pub(super) place: usize,
    /// It is to come to its end.
    pub(super) cancelled: Arc<AtomicBool>,
    /// Its own code ran until here, or is to have returned until then.
    pub(super) deadline_ns: AtomicU64,
    /// It ends without another word: nothing of it is entered any more.
    abandoned: AtomicBool,
    state: AtomicU8,
    verdict: AtomicU8,
    pulse: OnceLock<Arc<Pulse>>,
    runs: AtomicU64,
}

impl Task {
    pub(super) fn state_is(&self, state: State) -> bool {
        self.state.load(Ordering::SeqCst) == state as u8
    }

    /// Goes on to a state; false: it is gone meanwhile.
    pub(super) fn turn(&self, from: State, to: State) -> bool {
        self.state.compare_exchange(from as u8, to as u8, Ordering::SeqCst, Ordering::SeqCst).is_ok()
    }

    pub(super) fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::SeqCst)
    }

    pub(super) fn is_abandoned(&self) -> bool {
        self.abandoned.load(Ordering::SeqCst)
    }

    pub(super) fn runs_on(&self, pulse: &Arc<Pulse>) {
        let _ = self.pulse.set(Arc::clone(pulse));
    }

    pub(super) fn count_run(&self) {
        self.runs.fetch_add(1, Ordering::Relaxed);
    }

    /// How often it has run.
    #[must_use]
    pub fn runs(&self) -> u64 {
        self.runs.load(Ordering::Relaxed)
    }

    pub(super) fn verdict(&self) -> Verdict {
        match self.verdict.load(Ordering::SeqCst) {
            1 => Verdict::Again,
            2 => Verdict::Over,
            _ => Verdict::None,
        }
    }

    pub(super) fn set_verdict(&self, verdict: Verdict) {
        self.verdict.store(verdict as u8, Ordering::SeqCst);
    }

    /// Takes it away where none of its code runs; what runs is late from now on.
    fn take_away(&self) {
        self.abandoned.store(true, Ordering::SeqCst);
        if !self.turn(State::Resting, State::Gone) && !self.turn(State::Parked, State::Gone) {
            let deadline_ns = self.deadline_ns.load(Ordering::SeqCst);
            self.pulse.get().into_iter().for_each(|pulse| _ = pulse.cut_short(deadline_ns, clock::now_ns()));
        }
    }
}

/// What a task has to tell.
pub struct Post {
    /// Which task; its fault is answered.
    pub(super) task: Arc<Task>,
    /// What happened.
    pub(super) fault: Fault,
    /// It waits for a verdict.
    pub(super) asks: bool,
}

/// The tasks of a slot.
pub struct Tasks {
    /// The slot's name.
    pub(super) slot: &'static str,
    pub(super) signal: Arc<Signal>,
    /// How their threads are scheduled: as the slot's executor.
    schedule: OnceLock<Schedule>,
    waiter: Arc<Waiter>,
    pub(super) posts: ArrayQueue<Post>,
    // Held for a few instructions; no memory of a plugin is touched meanwhile.
    alive: Mutex<Vec<Arc<Task>>>,
    count: AtomicUsize,
    /// Rung by each that ends.
    ended: Waker,
}

impl Tasks {
    /// Of a slot that has none yet.
    #[must_use]
    pub fn new(slot: &'static str, signal: Arc<Signal>, waiter: Arc<Waiter>) -> Self {
        Self {
            slot,
            signal,
            schedule: OnceLock::new(),
            waiter,
            // One that asks waits for its answer.
            posts: ArrayQueue::new(8 * TASKS),
            alive: Mutex::default(),
            count: AtomicUsize::new(0),
            ended: Waker::default(),
        }
    }

    /// Says how their threads are scheduled; once.
    pub fn use_schedule(&self, schedule: &Schedule) {
        let _ = self.schedule.set(schedule.clone());
    }

    fn alive(&self) -> MutexGuard<'_, Vec<Arc<Task>>> {
        self.alive.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Those that have not come to their end.
    #[must_use]
    pub fn all(&self) -> Vec<Arc<Task>> {
        self.alive().clone()
    }

    /// True without any.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count.load(Ordering::SeqCst) == 0
    }

    /// Starts a task of that instance; one that is to run no more is only dropped.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn start(
        self: &Arc<Self>,
        spawned: &Spawned,
        instance: u64,
        limits: Limits,
        runs: bool,
    ) -> std::io::Result<()> {
        let Some(place) = self.signal.tasks().join() else {
            crowd::release(instance);
            return Err(std::io::Error::other("tasks of an earlier instance do not come to their end"));
        };
        let task = Arc::new(Task {
            name: spawned.name,
            period_ns: spawned.period_ns,
            number: instance::next_number(),
            instance,
            place,
            cancelled: Arc::new(AtomicBool::new(!runs)),
            deadline_ns: AtomicU64::new(0),
            abandoned: AtomicBool::new(false),
            state: AtomicU8::new(State::Resting as u8),
            verdict: AtomicU8::new(Verdict::None as u8),
            pulse: OnceLock::new(),
            runs: AtomicU64::new(0),
        });
        self.alive().push(Arc::clone(&task));
        self.count.fetch_add(1, Ordering::SeqCst);
        self.waiter.task_began();
        let budget_ns = spawned.budget_ns.unwrap_or(limits.hang_ns);
        let run = Run::new(task, Arc::clone(self), spawned.job, limits.stack_bytes, budget_ns);
        task_run::hand_out(run, self.schedule.get().unwrap_or(&Schedule::default()))
    }

    /// A task has come to its end.
    pub(super) fn leave(&self, task: &Arc<Task>) {
        self.alive().retain(|other| !Arc::ptr_eq(other, task));
        self.signal.tasks().leave(task.place);
        crowd::release(task.instance);
        self.waiter.task_ended();
        self.count.fetch_sub(1, Ordering::SeqCst);
        self.ended.wake();
    }

    /// A task tells what happened; the executor answers.
    pub(super) fn post(&self, post: Post) {
        // More at once than there is room for: the first ones are answered, and tell as much.
        let _ = self.posts.push(post);
        self.signal.ring(Ring::Task);
    }

    /// Ends all tasks: they are cancelled, and have that long to come to their end; `None`: the instance is not to be entered
    /// again, and neither are they. False: one of them had to be ended by force, or could not be.
    pub fn end(&self, grace: Option<Duration>) -> bool {
        if self.is_empty() {
            return true;
        }
        if let Some(grace) = grace {
            self.all().iter().for_each(|task| {
                task.cancelled.store(true, Ordering::SeqCst);
                self.signal.tasks().wake(task.place);
            });
            if self.wait_for_all(grace, || true) {
                return true;
            }
        }
        let take_away = || {
            let left = self.all();
            left.iter().for_each(|task| {
                task.cancelled.store(true, Ordering::SeqCst);
                task.take_away();
                self.signal.tasks().wake(task.place);
            });
            watchdog::look_again();
            left.iter().any(|task| !task.state_is(State::Gone))
        };
        if !self.wait_for_all(TASK_END_BY_FORCE, take_away) {
            tracing::error!("slot {}: a task does not come to its end: left behind", self.slot);
        }
        false
    }

    /// Waits until there are none, or until `goes_on` says that there is nothing to wait for.
    fn wait_for_all(&self, limit: Duration, goes_on: impl Fn() -> bool) -> bool {
        let until_ns = clock::now_ns() + nanoseconds(limit);
        while !self.is_empty() {
            let now_ns = clock::now_ns();
            if !goes_on() {
                return true;
            }
            if now_ns >= until_ns {
                return false;
            }
            // Again and again: between two looks one may have begun to run.
            self.ended.wait_until(Some(until_ns.min(now_ns + 1_000_000)));
        }
        true
    }
}
