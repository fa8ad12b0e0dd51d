//! When values arrive at an input with a `max_age`: two times that anybody may set and its reader looks at.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::detect::freshness::Arrivals;
use crate::sys::clock;

/// Arrivals at a port whose silence is a fault.
#[derive(Debug)]
pub struct Hearing {
    /// Silence longer than this is one, in nanoseconds.
    pub max_age_ns: u64,
    heard_ns: AtomicU64,
    since_ns: AtomicU64,
}

impl Hearing {
    /// Of a port at which nothing has arrived.
    #[must_use]
    pub const fn new(max_age_ns: u64) -> Self {
        Self { max_age_ns, heard_ns: AtomicU64::new(0), since_ns: AtomicU64::new(0) }
    }

    /// A value arrived, just now.
    #[inline]
    pub(super) fn heard(&self) {
        // To the nanosecond: what `recent_ns` may be wrong by is as long as many a `max_age`.
        self.heard_ns.store(clock::now_ns(), Ordering::Release);
    }

    /// Counts from now on: silence before is nobody's fault any more.
    pub fn begin(&self, now_ns: u64) {
        self.since_ns.fetch_max(now_ns, Ordering::AcqRel);
    }

    /// What is known of it.
    #[must_use]
    pub fn arrivals(&self) -> Arrivals {
        // A reset that is seen makes the value before it seen, too.
        let since_ns = self.since_ns.load(Ordering::Acquire);
        Arrivals { heard_ns: self.heard_ns.load(Ordering::Acquire), since_ns }
    }
}
