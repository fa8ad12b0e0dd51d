//! What a client that waits for the next value looks at, and whoever has something for it changes: values that arrived, and
//! ends of waits, each counted, so that nothing is missed that comes while the wait begins.
//!
//! A flag that the writer sets and the client takes away was the alternative: a value that comes between two waits would end
//! the second one.

use component_sdk::status::Status;

use crate::port::gate::Gate;
use crate::port::wait::Place;
use crate::sys::shared::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Counts of one client. Any thread, but for a wait: the client's own.
pub struct News {
    arrivals: AtomicU64,
    waiting: AtomicBool,
    /// How often waits were ended, and why the last time.
    ends: AtomicU32,
    end: AtomicU32,
}

/// What there was when a wait began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Known {
    arrivals: u64,
    ends: u32,
}

impl Default for News {
    fn default() -> Self {
        let (arrivals, waiting) = (AtomicU64::new(0), AtomicBool::new(false));
        Self { arrivals, waiting, ends: AtomicU32::new(0), end: AtomicU32::new(0) }
    }
}

impl News {
    /// What there is now: whatever comes from now on ends a wait that begins with it.
    pub fn known(&self) -> Known {
        Known { ends: self.ends.load(Ordering::Acquire), arrivals: self.arrivals.load(Ordering::Acquire) }
    }

    /// Waits for what comes after that, unless the gate was closed since `closings`, until `until_ns`. The client's own
    /// thread.
    ///
    /// # Errors
    /// Why nothing came: what ended the wait, `Cancelled`, `Timeout`.
    pub fn wait(
        &self,
        known: Known,
        gate: &Gate,
        closings: u32,
        until_ns: u64,
        place: &impl Place,
    ) -> Result<(), Status> {
        self.waiting.store(true, Ordering::Release);
        // It writes, though it changes nothing: whoever counts later sees that somebody waits, and who counted before is seen.
        self.arrivals.fetch_add(0, Ordering::AcqRel);
        let look = || self.since(known);
        // What came before rang for nobody.
        let end = look().unwrap_or_else(|| gate.wait(closings, until_ns, place, look));
        self.stop();
        end
    }

    /// Nobody waits any more: the wait is over, or whoever waited is gone.
    pub fn stop(&self) {
        self.waiting.store(false, Ordering::Relaxed);
    }

    /// How a wait ended that began with that.
    fn since(&self, known: Known) -> Option<Result<(), Status>> {
        if self.arrivals.load(Ordering::Acquire) != known.arrivals {
            return Some(Ok(()));
        }
        let is_ended = self.ends.load(Ordering::Acquire) != known.ends;
        is_ended.then(|| Err(Status::from_code(self.end.load(Ordering::Acquire))))
    }

    /// A value has arrived; true: somebody waits for it and is to be rung for.
    #[must_use]
    pub fn arrived(&self) -> bool {
        self.arrivals.fetch_add(1, Ordering::AcqRel);
        self.waiting.load(Ordering::Acquire)
    }

    /// Ends a wait that has begun; whoever waits is to be rung for.
    pub fn end(&self, status: Status) {
        self.end.store(status.code(), Ordering::Release);
        self.ends.fetch_add(1, Ordering::AcqRel);
    }
}
