//! A task's own side: a thread that carries it, with a fiber and a pulse of its own, as an executor has them.
//!
//! Threads that have carried a task wait for the next one and never end: one that a trap went through may not run the
//! thread-locals' destructors of a plugin, and whoever starts tasks again after each fault does not wait for a new thread.

use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use component_sdk::abi::class::CallStatus;
use component_sdk::abi::task::Phase;
use crossbeam_channel::{Receiver, Sender};

use super::callback;
use super::task::{Post, State, Task, Tasks, Verdict};
use crate::detect::crash;
use crate::model::fault::Fault;
use crate::model::limits::HANG_AT_STOP;
use crate::model::schedule::Schedule;
use crate::model::time::nanoseconds;
use crate::plugin::task::{self, Job};
use crate::sys::fiber::{Ended, Errand};
use crate::sys::fiber_pool::{FiberPool, Progress, Ticket};
use crate::sys::seat::{self, Owner};
use crate::sys::{carrier, clock, watchdog};

/// A task on its way to the thread that carries it.
pub(super) struct Run {
    task: Arc<Task>,
    home: Arc<Tasks>,
    job: Job,
    stack_bytes: usize,
    budget_ns: u64,
}

/// Threads of one schedule.
struct Carriers {
    schedule: Schedule,
    queue: (Sender<Run>, Receiver<Run>),
    /// Those that wait for a task, less the tasks that wait for one of them.
    free: Arc<AtomicIsize>,
}

static CARRIERS: Mutex<Vec<Carriers>> = Mutex::new(Vec::new());

/// Gives a task to a thread of that schedule.
///
/// # Errors
/// When a thread is needed and the system has none left.
pub(super) fn hand_out(run: Run, schedule: &Schedule) -> std::io::Result<()> {
    let mut carriers = CARRIERS.lock().unwrap_or_else(PoisonError::into_inner);
    let index = carriers.iter().position(|known| known.schedule == *schedule).unwrap_or_else(|| {
        let (schedule, queue, free) = (schedule.clone(), crossbeam_channel::unbounded(), Arc::default());
        carriers.push(Carriers { schedule, queue, free });
        carriers.len() - 1
    });
    let known = &carriers[index];
    if known.free.fetch_sub(1, Ordering::SeqCst) <= 0 {
        let (inbox, free) = (known.queue.1.clone(), Arc::clone(&known.free));
        let refused = |reason: &str| tracing::warn!("tasks: {reason}");
        if let Err(error) = carrier::spawn("task", schedule.clone(), refused, move || carry_all(&inbox, &free)) {
            known.free.fetch_add(1, Ordering::SeqCst);
            run.home.leave(&run.task);
            return Err(error);
        }
    }
    // Both ends are kept here: it cannot be closed.
    let _ = known.queue.0.send(run);
    Ok(())
}

fn carry_all(inbox: &Receiver<Run>, free: &AtomicIsize) {
    let mut fibers = FiberPool::<Part>::default();
    while let Ok(run) = inbox.recv() {
        // Kept for as long as the thread does nothing else.
        let _ = nix::sys::prctl::set_name(&name(run.task.name.as_str()));
        Carried { run, fibers: &mut fibers }.see_through();
        fibers.bury();
        free.fetch_add(1, Ordering::SeqCst);
    }
}

/// As much of a task's name as a thread's takes.
fn name(name: &str) -> std::ffi::CString {
    let short: String = name.chars().filter(|character| *character != '\0').take(15).collect();
    std::ffi::CString::new(short).unwrap_or_default()
}

/// How a part of a task ended.
enum Went {
    Well,
    /// The instance is sound.
    Failed(Fault),
    /// It is not.
    Trapped(Fault),
    /// It was taken away.
    Gone,
}

/// What the fiber is given.
struct Part {
    job: Job,
    phase: Phase,
    now_ns: u64,
    status: CallStatus,
}

impl Errand for Part {
    type Report = CallStatus;

    fn run(&mut self) {
        self.status = self.job.enter(self.phase, self.now_ns);
    }

    fn report(&self) -> CallStatus {
        self.status
    }
}

impl Run {
    pub(super) const fn new(task: Arc<Task>, home: Arc<Tasks>, job: Job, stack_bytes: usize, budget_ns: u64) -> Self {
        Self { task, home, job, stack_bytes, budget_ns }
    }
}

/// A task on its thread.
struct Carried<'a> {
    run: Run,
    fibers: &'a mut FiberPool<Part>,
}

impl Carried<'_> {
    fn see_through(mut self) {
        self.run.task.runs_on(self.fibers.pulse());
        watchdog::expect(self.fibers.pulse(), self.run.budget_ns);
        // Ready ones, so that a fault finds another.
        let _ = self.fibers.prepare(self.run.stack_bytes, 1);
        if self.runs() {
            self.drop_job();
        }
        self.run.task.turn(State::Resting, State::Gone);
        self.run.home.leave(&self.run.task);
    }

    /// All of its runs; false: nothing of it may be entered any more.
    fn runs(&mut self) -> bool {
        let mut next = Some(Phase::Enter);
        let mut due_ns = clock::now_ns();
        while let Some(phase) = next.filter(|_| !self.run.task.is_cancelled()) {
            let went = self.enter(phase);
            if phase == Phase::Execute {
                self.run.task.count_run();
            }
            next = match went {
                Went::Well if phase == Phase::Enter => Some(Phase::Execute),
                Went::Well => self.next_period(&mut due_ns),
                Went::Failed(fault) if self.is_to_go_on(fault) => match self.run.task.period_ns {
                    Some(_) if phase == Phase::Execute => self.next_period(&mut due_ns),
                    _ => Some(phase),
                },
                Went::Failed(_) => return true,
                Went::Trapped(fault) => {
                    self.tell(fault, false);
                    return false;
                }
                Went::Gone => return false,
            };
        }
        // One that never ran has nothing to end.
        let began = self.run.task.runs() > 0;
        match if began { self.enter(Phase::Exit) } else { Went::Well } {
            Went::Well => true,
            Went::Failed(fault) => {
                self.tell(fault, false);
                true
            }
            Went::Trapped(fault) => {
                self.tell(fault, false);
                false
            }
            Went::Gone => false,
        }
    }

    /// Waits for its next period; `None`: there is none, or it is cancelled.
    fn next_period(&self, due_ns: &mut u64) -> Option<Phase> {
        let (task, period_ns) = (&self.run.task, self.run.task.period_ns?);
        let mut now_ns = clock::now_ns();
        // Periods that are over already are left out.
        *due_ns += ((now_ns.saturating_sub(*due_ns)) / period_ns + 1) * period_ns;
        while now_ns < *due_ns && !task.is_cancelled() {
            self.run.home.signal.tasks().wait(task.place, Some(*due_ns));
            now_ns = clock::now_ns();
        }
        (!task.is_cancelled()).then_some(Phase::Execute)
    }

    /// Tells of a fault, and waits for what is made of it.
    fn is_to_go_on(&self, fault: Fault) -> bool {
        let task = &self.run.task;
        task.set_verdict(Verdict::None);
        self.tell(fault, true);
        while task.verdict() == Verdict::None && !task.is_cancelled() {
            self.run.home.signal.tasks().wait(task.place, None);
        }
        task.verdict() == Verdict::Again
    }

    fn tell(&self, fault: Fault, asks: bool) {
        // Of one that was taken away, that it ended so is no news.
        if !self.run.task.is_abandoned() {
            self.run.home.post(Post { task: Arc::clone(&self.run.task), fault, asks });
        }
    }

    /// Until when what is entered now must return, or wait.
    fn deadline_ns(&self, now_ns: u64, phase: Phase) -> u64 {
        let budget_ns = if phase == Phase::Exit { nanoseconds(HANG_AT_STOP) } else { self.run.budget_ns };
        let deadline_ns = now_ns.saturating_add(budget_ns);
        self.run.task.deadline_ns.store(deadline_ns, Ordering::SeqCst);
        deadline_ns
    }

    /// Whose code runs on this thread from now on.
    fn take_seat(&self) {
        let owner = Owner { slot: self.run.home.slot, instance: self.run.task.instance };
        seat::enter_task(owner, self.run.task.number);
        task::set_current(&self.run.task.cancelled);
    }

    /// Enters a part of the task, and sees it through its waits.
    fn enter(&mut self, phase: Phase) -> Went {
        if !self.run.task.turn(State::Resting, State::Running) {
            return Went::Gone;
        }
        let now_ns = clock::now_ns();
        let deadline_ns = self.deadline_ns(now_ns, phase);
        let part = Part { job: self.run.job, phase, now_ns, status: CallStatus::Done };
        self.take_seat();
        let may_wait = !self.run.task.is_cancelled();
        let mut progress =
            match self.fibers.begin(self.run.stack_bytes, deadline_ns, may_wait, |place| *place = Some(part)) {
                Ok(progress) => progress,
                Err(error) => return self.rest(Went::Failed(callback::no_stack(&error))),
            };
        loop {
            let went = match progress {
                Progress::Done(status) => outcome(status),
                Progress::Trapped(_) => Went::Trapped(callback::last_trap(self.fibers)),
                Progress::Waits(ticket, until_ns) => {
                    self.side_report();
                    match self.wait(ticket, until_ns, phase) {
                        Some(next) => {
                            progress = next;
                            continue;
                        }
                        None => return Went::Gone,
                    }
                }
            };
            self.side_report();
            return self.rest(went);
        }
    }

    fn rest(&self, went: Went) -> Went {
        self.run.task.turn(State::Running, State::Resting);
        went
    }

    /// Waits with the fiber, then goes on with it; `None`: it was taken away.
    fn wait(&mut self, ticket: Ticket, until_ns: u64, phase: Phase) -> Option<Progress<CallStatus>> {
        let task = Arc::clone(&self.run.task);
        task.turn(State::Running, State::Parked);
        if !task.is_cancelled() {
            self.run.home.signal.tasks().wait(task.place, Some(until_ns));
        }
        if !task.turn(State::Parked, State::Running) {
            self.fibers.abandon(ticket);
            return None;
        }
        let deadline_ns = self.deadline_ns(clock::now_ns(), phase);
        self.take_seat();
        // One that is cancelled waits for nothing any more.
        self.fibers.go_on(ticket, deadline_ns, !task.is_cancelled())
    }

    /// What it told on the side: a bad value that it wrote, a fault that it raised.
    fn side_report(&self) {
        if let Some(fault) = callback::side_report() {
            self.tell(fault, false);
        }
    }

    fn drop_job(&mut self) {
        if !self.run.task.turn(State::Resting, State::Running) {
            return;
        }
        let (mut job, mut status) = (self.run.job, CallStatus::Done);
        let deadline_ns = self.deadline_ns(clock::now_ns(), Phase::Exit);
        self.take_seat();
        let ended = self.fibers.run(self.run.stack_bytes, deadline_ns, &mut || status = job.destroy());
        let fault = match ended {
            Ok(Ended::Returned) => crash::of_status(status).map(|symptom| callback::told(symptom, "")),
            Ok(Ended::Trapped) => Some(callback::last_trap(self.fibers)),
            Err(error) => Some(callback::no_stack(&error)),
        };
        self.run.task.turn(State::Running, State::Resting);
        if let Some(fault) = fault {
            self.tell(fault, false);
        }
    }
}

fn outcome(status: CallStatus) -> Went {
    crash::of_status(status).map_or(Went::Well, |symptom| Went::Failed(callback::told(symptom, "")))
}
