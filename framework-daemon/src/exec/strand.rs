//! A callback that may wait: what its fiber is given, and where it stands.
//!
//! While it waits its executor runs other members, and enters no other callback of this one: a component is never
//! surprised in the middle of a callback. Waits count neither as hang nor as overrun; each stretch between them must
//! return, or wait again, within the budget of a callback.
//!
//! A thread for each callback was the alternative: it costs two wake-ups where this costs two switches of registers.

use component_sdk::abi::calls::ServeArgs;
use component_sdk::abi::class::{CallArgs, CallStatus, FaultArgs, Hook};

use super::callback::Call;
use super::unit::Limits;
use crate::plugin::instance::Entry;
use crate::sys::bell::Rings;
use crate::sys::fiber::Errand;
use crate::sys::fiber_pool::Ticket;
use crate::sys::{clock, trap};

/// One callback of so many is measured exactly where none has to be.
const SAMPLED: u32 = 16;

/// Which callback it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Job {
    /// `on_execute`, begun with so many values waiting in the slot's queues.
    Execute {
        /// So many.
        queued: usize,
    },
    /// `recover`, `start` and, where the slot executes, the first `on_execute` of a successor, one after the other: to go
    /// through its executor in between takes longer than they do.
    Succeed {
        /// The slot executes.
        executes: bool,
    },
    /// The handler of a request.
    Serve,
    /// None yet.
    #[default]
    None,
}

/// True of callbacks in which a component may wait.
#[must_use]
pub const fn may_wait(hook: Hook) -> bool {
    matches!(hook, Hook::Execute | Hook::Serve | Hook::Event)
}

/// How far a callback got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pause {
    /// It is done.
    Done,
    /// It waits.
    Waits,
}

/// A member's callback that may wait.
#[derive(Default)]
pub struct Strand {
    /// What it is at, or was last.
    pub job: Job,
    /// How long it ran so far, waits left out, in nanoseconds.
    pub ran_ns: u64,
    /// What is measured of it is exact.
    pub exact: bool,
    begun: u32,
    /// What was rung for meanwhile.
    held: Rings,
    last: Option<Last>,
    waiting: Option<(Ticket, u64)>,
}

impl Strand {
    /// Another callback begins.
    pub fn take_up(&mut self, job: Job) {
        (self.job, self.ran_ns) = (job, 0);
        self.begun = self.begun.wrapping_add(1);
    }

    /// What is taken up now may wait.
    #[inline]
    pub(super) const fn may_wait(&self) -> bool {
        !matches!(self.job, Job::Succeed { .. })
    }

    /// One of many is measured exactly.
    #[must_use]
    pub const fn is_sample(&self) -> bool {
        self.begun.is_multiple_of(SAMPLED)
    }

    /// True while it waits.
    #[must_use]
    pub const fn waits(&self) -> bool {
        self.waiting.is_some()
    }

    /// Until when it waits.
    #[must_use]
    pub fn until_ns(&self) -> Option<u64> {
        self.waiting.as_ref().map(|(_, until_ns)| *until_ns)
    }

    /// Something is to be looked at when it is done.
    pub fn hold(&mut self, rings: Rings) {
        self.held = self.held.and(rings);
    }

    /// What is to be looked at now.
    #[must_use]
    pub fn release(&mut self) -> Rings {
        std::mem::take(&mut self.held)
    }

    pub(super) fn wait(&mut self, ticket: Ticket, until_ns: u64) {
        self.waiting = Some((ticket, until_ns));
    }

    pub(super) fn take_ticket(&mut self) -> Option<Ticket> {
        self.waiting.take().map(|(ticket, _)| ticket)
    }

    /// The callback of a succession that was entered last; `None`: it waits, or none was.
    #[must_use]
    pub fn last(&self) -> Option<Last> {
        self.last.filter(|_| !self.waits())
    }

    /// Another succession begins.
    pub(super) fn forget(&mut self) {
        self.last = None;
    }

    /// What came back from the fiber.
    pub(super) fn note(&mut self, last: Last) {
        self.last = Some(last);
    }
}

/// A callback that was entered, and ended.
#[derive(Clone, Copy, Debug)]
pub struct Last {
    /// Which one.
    pub hook: Hook,
    /// When it was entered.
    pub began_ns: u64,
    /// When it returned; known of the first `on_execute` of a successor only.
    pub ended_ns: u64,
    /// How.
    pub(super) status: CallStatus,
}

impl Last {
    /// Of one that waits.
    pub(super) fn waiting() -> Self {
        Self { hook: Hook::Execute, began_ns: clock::now_ns(), ended_ns: 0, status: CallStatus::Done }
    }
}

/// What the fiber is given.
pub struct Frame {
    entry: Entry,
    args: CallArgs<'static>,
    /// Of what follows.
    limits: Limits,
    next: Next,
    status: CallStatus,
    /// When the last callback of a succession returned.
    ended_ns: u64,
}

/// What follows on the same fiber.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    Nothing,
    Start,
    StartAndExecute,
}

impl Next {
    const fn of(job: Job) -> Self {
        match job {
            Job::Succeed { executes: true } => Self::StartAndExecute,
            Job::Succeed { executes: false } => Self::Start,
            _ => Self::Nothing,
        }
    }
}

impl Frame {
    /// For that callback. What a callback does not look at stays as the one before left it: each line counts on the way into every
    /// one.
    #[inline(always)]
    pub(super) fn enter(place: &mut Option<Self>, entry: Entry, job: Job, call: &Call<'static>, limits: &Limits) {
        let Some(frame) = place else {
            *place = Some(Self::anew(entry, call.args(), limits, job));
            return;
        };
        (frame.entry, frame.next, frame.status) = (entry, Next::Nothing, CallStatus::Done);
        call.fill(&mut frame.args);
        if matches!(job, Job::Succeed { .. }) {
            (frame.next, frame.limits) = (Next::of(job), *limits);
        }
    }

    #[cold]
    const fn anew(entry: Entry, args: CallArgs<'static>, limits: &Limits, job: Job) -> Self {
        Self { entry, args, limits: *limits, next: Next::of(job), status: CallStatus::Done, ended_ns: 0 }
    }

    /// For handlers of that instance.
    pub(super) const fn serving(entry: Entry, limits: &Limits) -> Self {
        Self::anew(entry, Call::plain(Hook::Serve).args(), limits, Job::Serve)
    }

    /// What the handler is to serve. Its time is not known.
    pub(super) fn take_up(&mut self, serve: ServeArgs) {
        self.args.serve = serve;
    }

    /// The callback returned as it should.
    pub(super) fn is_done(&self) -> bool {
        self.status == CallStatus::Done
    }

    /// The same, and nothing was to follow it: there is no more to be said of it.
    #[inline]
    pub(super) fn is_plainly_done(&self) -> bool {
        self.is_done() && self.next == Next::Nothing
    }

    /// Whatever follows the callback.
    #[inline(never)]
    fn succeed(&mut self) {
        while self.status == CallStatus::Done && self.turn_to_next() {
            self.status = self.entry.enter(&self.args);
        }
        if self.next == Next::StartAndExecute {
            self.ended_ns = clock::now_ns();
        }
    }

    /// Turns to the next callback of a succession; false: there is none.
    fn turn_to_next(&mut self) -> bool {
        let hook = match (self.next, self.args.hook) {
            (Next::Start | Next::StartAndExecute, Hook::Recover) => Hook::Start,
            (Next::StartAndExecute, Hook::Start) => Hook::Execute,
            _ => return false,
        };
        // `start` has seconds: whether `recover` took microseconds or all that it may is nothing to it.
        let (now_ns, begins_ns) = if hook == Hook::Start {
            (0, self.args.now_ns.saturating_add(self.limits.of(self.args.hook)))
        } else {
            let now_ns = clock::now_ns();
            (now_ns, now_ns)
        };
        self.args = CallArgs { hook, inject: 0, now_ns, fault: FaultArgs::NONE, serve: ServeArgs::NONE };
        trap::rearm(begins_ns.saturating_add(self.limits.of(hook)), may_wait(hook));
        true
    }
}

impl Errand for Frame {
    type Report = Last;

    fn run(&mut self) {
        self.status = self.entry.enter(&self.args);
        if self.next != Next::Nothing {
            self.succeed();
        }
    }

    fn report(&self) -> Last {
        Last { hook: self.args.hook, began_ns: self.args.now_ns, ended_ns: self.ended_ns, status: self.status }
    }
}
