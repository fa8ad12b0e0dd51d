//! Until when the callback that runs on an executor must have returned. Written by the executor's own entering and leaving
//! of callbacks and by nothing else; read by the watchdog.

use std::sync::atomic::{AtomicI32, AtomicU32, AtomicU64, Ordering};

use crate::model::limits::HANG_AT_STOP;
use crate::model::time::nanoseconds;

/// No callback runs.
const AT_REST: u64 = 0;

/// One for each executor. On a cache line of its own: it is written with every callback.
#[derive(Debug)]
#[repr(align(64))]
pub struct Pulse {
    deadline_ns: AtomicU64,
    thread: AtomicI32,
    attempts: AtomicU32,
    shortest_ns: AtomicU64,
}

impl Default for Pulse {
    fn default() -> Self {
        Self {
            deadline_ns: AtomicU64::new(AT_REST),
            thread: AtomicI32::new(0),
            attempts: AtomicU32::new(0),
            shortest_ns: AtomicU64::new(nanoseconds(HANG_AT_STOP)),
        }
    }
}

impl Pulse {
    /// A callback is entered that must return until then.
    #[inline]
    pub fn begin(&self, deadline_ns: u64) {
        self.deadline_ns.store(deadline_ns, Ordering::Relaxed);
    }

    /// It returned, or its fiber ended.
    #[inline]
    pub fn end(&self) {
        self.deadline_ns.store(AT_REST, Ordering::Relaxed);
    }

    /// True while a callback runs.
    #[must_use]
    pub fn is_beating(&self) -> bool {
        self.deadline_ns.load(Ordering::Relaxed) != AT_REST
    }

    /// Until when the callback that runs must return.
    #[must_use]
    pub fn deadline_ns(&self) -> Option<u64> {
        Some(self.deadline_ns.load(Ordering::Relaxed)).filter(|deadline| *deadline != AT_REST)
    }

    /// What must have returned until then is late already; false: it is not that what runs.
    pub fn cut_short(&self, deadline_ns: u64, now_ns: u64) -> bool {
        deadline_ns != AT_REST
            && self.deadline_ns.compare_exchange(deadline_ns, now_ns, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }

    /// The kernel thread that runs the executor now.
    pub fn move_to(&self, thread: i32) {
        self.thread.store(thread, Ordering::Release);
    }

    /// The kernel thread that runs the executor.
    #[must_use]
    pub fn thread(&self) -> i32 {
        self.thread.load(Ordering::Acquire)
    }

    /// How often the callback that runs was asked to end, this time included.
    pub fn attempt(&self) -> u32 {
        self.attempts.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// The callback that was asked is gone.
    pub fn forget_attempts(&self) {
        self.attempts.store(0, Ordering::Relaxed);
    }

    /// Callbacks may be entered with as little time as this; true where that is less than before.
    pub fn shorten(&self, limit_ns: u64) -> bool {
        self.shortest_ns.fetch_min(limit_ns, Ordering::Relaxed) > limit_ns
    }

    /// The least time that a callback is entered with.
    #[must_use]
    pub fn shortest_ns(&self) -> u64 {
        self.shortest_ns.load(Ordering::Relaxed)
    }
}
