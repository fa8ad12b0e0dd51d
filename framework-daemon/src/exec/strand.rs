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
    /// Kept between callbacks, so that none allocates.
    frame: Option<Box<Frame>>,
    waiting: Option<(Ticket, u64)>,
}

impl Strand {
    /// Another callback begins.
    pub fn take_up(&mut self, job: Job) {
        (self.job, self.ran_ns) = (job, 0);
        self.begun = self.begun.wrapping_add(1);
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

    /// What the fiber is given to enter the callback.
    pub(super) fn frame(&mut self, entry: Entry, call: &Call<'static>, limits: &Limits) -> Box<Frame> {
        let (next, status) = (Next::of(self.job), CallStatus::Done);
        match self.frame.take() {
            Some(mut frame) => {
                (frame.entry, frame.next, frame.status) = (entry, next, status);
                call.fill(&mut frame.args);
                if next != Next::Nothing {
                    frame.limits = *limits;
                }
                frame
            }
            None => Box::new(Frame { entry, args: call.args(), limits: *limits, next, status, ended_ns: 0 }),
        }
    }

    /// The frame that is kept between callbacks, where another one takes its place.
    pub(super) fn spare_frame(&mut self) -> Option<Box<Frame>> {
        self.frame.take()
    }

    /// The callback that was entered last; `None`: it waits.
    #[must_use]
    pub fn last(&self) -> Option<Last> {
        self.frame.as_ref().map(|frame| Last {
            hook: frame.args.hook,
            began_ns: frame.args.now_ns,
            ended_ns: frame.ended_ns,
        })
    }

    /// What came back from the fiber: how the callback ended.
    pub(super) fn put_back(&mut self, frame: Box<Frame>) -> CallStatus {
        let status = frame.status;
        self.frame = Some(frame);
        status
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
}

impl Last {
    /// Of one that waits.
    pub(super) fn waiting() -> Self {
        Self { hook: Hook::Execute, began_ns: clock::now_ns(), ended_ns: 0 }
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
    /// For handlers of that instance.
    pub(super) const fn serving(entry: Entry, limits: Limits) -> Self {
        let args = Call::plain(Hook::Serve).args();
        Self { entry, args, limits, next: Next::Nothing, status: CallStatus::Done, ended_ns: 0 }
    }

    /// The same, for another instance.
    pub(super) fn serve_for(&mut self, entry: Entry, limits: Limits) {
        *self = Self::serving(entry, limits);
    }

    /// What the handler is to serve. Its time is not known.
    pub(super) fn take_up(&mut self, serve: ServeArgs) {
        self.args.serve = serve;
    }

    /// The callback returned as it should.
    pub(super) fn is_done(&self) -> bool {
        self.status == CallStatus::Done
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
    fn run(&mut self) {
        self.status = self.entry.enter(&self.args);
        while self.status == CallStatus::Done && self.turn_to_next() {
            self.status = self.entry.enter(&self.args);
        }
        if self.next == Next::StartAndExecute {
            self.ended_ns = clock::now_ns();
        }
    }
}
