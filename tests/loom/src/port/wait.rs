//! `port::wait` for the checker: time stands still, and nobody waits in a ring.

use std::sync::Arc;

/// Nobody may wait here.
#[derive(Clone, Copy, Debug)]
pub struct NotHere;

/// Where a wait takes place.
pub trait Place {
    /// Now.
    fn now_ns(&self) -> u64;

    /// The moment so many nanoseconds from now.
    fn in_ns(&self, time_ns: u64) -> u64 {
        self.now_ns().saturating_add(time_ns)
    }

    /// Lets others run.
    ///
    /// # Errors
    /// Where nobody may wait.
    fn park(&self, until_ns: u64) -> Result<(), NotHere>;
}

/// Whoever waits.
#[derive(Debug)]
pub struct Waiter;

impl Waiter {
    /// One more.
    #[must_use]
    pub fn new() -> Arc<Self> {
        Arc::new(Self)
    }

    /// Begins to wait.
    #[must_use]
    pub const fn begin(&self, _: &Self) -> bool {
        true
    }

    /// It waits for another one, which runs on its time.
    pub const fn note(&self, _: &Self) {}

    /// Ends.
    pub const fn end(&self) {}
}
