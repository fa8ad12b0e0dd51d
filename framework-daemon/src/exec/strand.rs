//! A callback that may wait: what its fiber is given, and where it stands.
//!
//! While it waits its executor runs other members, and enters no other callback of this one: a component is never
//! surprised in the middle of a callback. Waits count neither as hang nor as overrun; each stretch between them must
//! return, or wait again, within the budget of a callback.
//!
//! A thread for each callback was the alternative: it costs two wake-ups where this costs two switches of registers.

use std::any::Any;

use component_sdk::abi::class::{CallArgs, CallStatus};

use crate::plugin::instance::Entry;
use crate::sys::bell::Rings;
use crate::sys::fiber::Errand;
use crate::sys::fiber_pool::Ticket;

/// Which callback it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Job {
    /// `on_execute`, begun with so many values waiting in the slot's queues.
    Execute {
        /// So many.
        queued: usize,
    },
    /// None yet.
    #[default]
    None,
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
    /// What was rung for meanwhile.
    pub held: Rings,
    /// Kept between callbacks, so that none allocates.
    frame: Option<Box<Frame>>,
    waiting: Option<(Ticket, u64)>,
}

impl Strand {
    /// Another callback begins.
    pub fn take_up(&mut self, job: Job) {
        (self.job, self.ran_ns) = (job, 0);
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

    pub(super) fn wait(&mut self, ticket: Ticket, until_ns: u64) {
        self.waiting = Some((ticket, until_ns));
    }

    pub(super) fn take_ticket(&mut self) -> Option<Ticket> {
        self.waiting.take().map(|(ticket, _)| ticket)
    }

    /// What the fiber is given to enter the callback.
    pub(super) fn frame(&mut self, entry: Entry, args: CallArgs<'static>) -> Box<Frame> {
        let fresh = Frame { entry, args, status: CallStatus::Done };
        match self.frame.take() {
            Some(mut frame) => {
                *frame = fresh;
                frame
            }
            None => Box::new(fresh),
        }
    }

    /// What came back from the fiber: how the callback ended.
    pub(super) fn put_back(&mut self, errand: Box<dyn Errand>) -> CallStatus {
        self.frame = errand.into_any().downcast().ok();
        self.frame.as_ref().map_or(CallStatus::Done, |frame| frame.status)
    }
}

/// What the fiber is given.
pub struct Frame {
    entry: Entry,
    args: CallArgs<'static>,
    status: CallStatus,
}

impl Errand for Frame {
    fn run(&mut self) {
        self.status = self.entry.enter(&self.args);
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}
