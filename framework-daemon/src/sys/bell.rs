//! What makes an executor look at one of its members: data, a request, an answer. Where both sides share an executor the
//! member is only queued and runs when the callback of the other returns or waits: no thread hop.
//!
//! Who rings says why, not what: the member looks at its ports itself. So a ring too many costs a look, and none is lost:
//! an executor looks at its queue before it sleeps.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};

use crossbeam_queue::ArrayQueue;

use super::wake::Waker;
use crate::model::limits::SLOTS;

/// Room for every slot of a plan on one executor, and for the numbers of members that left while they were in the queue.
pub const MEMBERS_MAX: usize = 2 * SLOTS;

/// What others may touch of an executor.
pub struct Bell {
    waker: Waker,
    ready: ArrayQueue<usize>,
    retired: AtomicBool,
}

thread_local! {
    static HERE: Cell<*const Bell> = const { Cell::new(std::ptr::null()) };
}

impl Bell {
    /// A silent one.
    #[must_use]
    pub fn new() -> Arc<Self> {
        Arc::new(Self { waker: Waker::default(), ready: ArrayQueue::new(MEMBERS_MAX), retired: AtomicBool::new(false) })
    }

    /// Says that the calling thread is this executor's; true where it was not before.
    #[inline(never)]
    pub fn adopt(self: &Arc<Self>) -> bool {
        !std::ptr::eq(HERE.replace(Arc::as_ptr(self)), Arc::as_ptr(self))
    }

    /// The executor's thread will do nothing any more, though it may not end.
    pub fn retire(&self) {
        self.retired.store(true, Ordering::Release);
    }

    /// True after [`Self::retire`].
    #[must_use]
    pub fn is_retired(&self) -> bool {
        self.retired.load(Ordering::Acquire)
    }

    /// Wakes the executor.
    pub fn wake(&self) {
        self.waker.wake();
    }

    /// Waits for a wake-up or the deadline; returns at once while somebody is to be looked at.
    pub fn wait_until(&self, deadline_ns: Option<u64>) {
        if self.ready.is_empty() {
            self.waker.wait_until(deadline_ns);
        }
    }

    /// The next member to look at.
    #[must_use]
    pub fn next_ready(&self) -> Option<usize> {
        self.ready.pop()
    }

    fn ring(&self, member: usize) {
        // Each member is in the queue at most once, so that it cannot be full.
        let _ = self.ready.push(member);
        if !std::ptr::eq(HERE.get(), self) {
            self.waker.wake();
        }
    }
}

/// Why a member is to be looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Ring {
    /// Data arrived.
    Data = 1,
    /// Somebody asks for a service.
    Serve = 2,
    /// What its callback waits for may be there.
    Wait = 4,
}

/// Why a member was rung for since it was looked at last: several reasons at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rings(u32);

impl From<Ring> for Rings {
    fn from(why: Ring) -> Self {
        Self(why as u32)
    }
}

impl Rings {
    /// True when this is one of the reasons.
    #[must_use]
    pub const fn has(self, why: Ring) -> bool {
        self.0 & why as u32 != 0
    }

    /// True without any.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// All but this one.
    #[must_use]
    pub const fn without(self, why: Ring) -> Self {
        Self(self.0 & !(why as u32))
    }

    /// Those of both.
    #[must_use]
    pub const fn and(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }
}

/// Rings for one member; shared by its ports.
pub struct Signal {
    bell: Arc<Bell>,
    member: AtomicUsize,
    rings: AtomicU32,
}

impl Signal {
    /// Of a member that has no number yet.
    #[must_use]
    pub fn new(bell: Arc<Bell>) -> Arc<Self> {
        Arc::new(Self { bell, member: AtomicUsize::new(usize::MAX), rings: AtomicU32::new(0) })
    }

    /// Sets the member's number.
    pub fn assign(&self, member: usize) {
        self.member.store(member, Ordering::Release);
    }

    /// Why it was rung for; the next ring queues the member again.
    #[must_use]
    pub fn take(&self) -> Rings {
        Rings(self.rings.swap(0, Ordering::AcqRel))
    }

    /// Has the member looked at.
    pub fn ring(&self, why: Ring) {
        self.ring_again(why.into());
    }

    /// Has the member looked at for reasons that were taken too early.
    pub fn ring_again(&self, rings: Rings) {
        let member = self.member.load(Ordering::Acquire);
        if member != usize::MAX && !rings.is_empty() && self.rings.fetch_or(rings.0, Ordering::AcqRel) == 0 {
            self.bell.ring(member);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_values_ring_once_until_the_member_is_looked_at() {
        let bell = Bell::new();
        let signal = Signal::new(Arc::clone(&bell));
        signal.ring(Ring::Data);
        assert_eq!(bell.next_ready(), None, "without a number nobody is looked at");
        signal.assign(3);
        (0..5).for_each(|_| signal.ring(Ring::Data));
        signal.ring(Ring::Wait);
        assert_eq!((bell.next_ready(), bell.next_ready()), (Some(3), None));
        let rings = signal.take();
        assert!(rings.has(Ring::Data) && rings.has(Ring::Wait) && !rings.has(Ring::Serve));
        signal.ring_again(rings.without(Ring::Wait));
        assert_eq!(bell.next_ready(), Some(3));
        assert!(!signal.take().has(Ring::Wait) && signal.take().is_empty());
    }
}
