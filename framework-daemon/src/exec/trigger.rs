//! Data wakes a nonperiodic slot. Where writer and reader share an executor, the reader is only queued and runs when the
//! writer's callback returns: no thread hop.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use crossbeam_queue::ArrayQueue;

use crate::model::limits::SLOTS;
use crate::port::input::Listener;
use crate::sys::wake::Waker;

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

    /// Waits for a wake-up or the deadline; returns at once while somebody is ready.
    pub fn wait_until(&self, deadline_ns: Option<u64>) {
        if self.ready.is_empty() {
            self.waker.wait_until(deadline_ns);
        }
    }

    /// The next ready member.
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

/// Marks one member ready; shared by its input ports.
pub struct Signal {
    bell: Arc<Bell>,
    member: AtomicUsize,
    ready: AtomicBool,
}

impl Signal {
    /// Of a member that has no number yet.
    #[must_use]
    pub fn new(bell: Arc<Bell>) -> Arc<Self> {
        Arc::new(Self { bell, member: AtomicUsize::new(usize::MAX), ready: AtomicBool::new(false) })
    }

    /// Sets the member's number.
    pub fn assign(&self, member: usize) {
        self.member.store(member, Ordering::Release);
    }

    /// The member is about to run: data that arrives from now on rings again.
    pub fn clear(&self) {
        self.ready.store(false, Ordering::Release);
    }

    /// Marks the member ready.
    pub fn ring(&self) {
        let member = self.member.load(Ordering::Acquire);
        if member != usize::MAX && !self.ready.swap(true, Ordering::AcqRel) {
            self.bell.ring(member);
        }
    }
}

/// A port's listener that rings for its member.
pub struct Doorbell(pub Arc<Signal>);

impl Listener for Doorbell {
    fn data_arrived(&self) {
        self.0.ring();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_values_ring_once_until_the_member_runs() {
        let bell = Bell::new();
        let signal = Signal::new(Arc::clone(&bell));
        signal.ring();
        assert_eq!(bell.next_ready(), None, "without a number nobody is ready");
        signal.assign(3);
        (0..5).for_each(|_| signal.ring());
        assert_eq!((bell.next_ready(), bell.next_ready()), (Some(3), None));
        signal.clear();
        signal.ring();
        assert_eq!(bell.next_ready(), Some(3));
    }
}
