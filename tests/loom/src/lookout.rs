//! `sys::lookout` for the checker, whose time stands still: whoever waits sleeps at once.

use crate::wake::Waker;

/// How an executor waits.
#[derive(Debug, Default)]
pub struct Lookout {}

impl Lookout {
    /// Wakes whoever waits here.
    #[allow(clippy::unused_self, reason = "as the other one")]
    pub fn wake(&self, waker: &Waker) {
        waker.wake();
    }

    /// Waits for a wake-up.
    pub fn wait_until(&self, waker: &Waker, deadline_ns: Option<u64>) {
        waker.wait_until(deadline_ns);
    }
}
