//! How an executor that has nothing to do waits: it looks out for a moment before it sleeps, where that was worth it lately.
//!
//! To fall asleep and to be woken takes two threads some ten microseconds, many times what a hop takes otherwise. To look out
//! for as long as that costs at most twice what the better choice would have (Karlin et al. 1990, competitive spinning); and
//! to do so only while waits prove to be that short costs nothing where they are not: executors of periodic components sleep
//! at once. To look out always was the alternative: it takes a processor that others need.

use std::sync::atomic::{AtomicU32, Ordering};

use super::clock;
use super::wake::Waker;
use crate::model::limits::LOOK_OUT;
use crate::model::time::nanoseconds;

const LOOK_OUT_NS: u64 = nanoseconds(LOOK_OUT);
/// A sleep that is over so soon: to look out would have been better.
const SHORT_SLEEP_NS: u64 = 2 * LOOK_OUT_NS;
/// Times that it may be in vain, one after the other.
const CREDIT_MAX: u32 = 4;

/// What was found out about the waits of one thread. Written by it alone.
#[derive(Debug, Default)]
pub struct Lookout {
    credit: AtomicU32,
}

impl Lookout {
    /// Waits for a wake-up or the deadline.
    pub fn wait_until(&self, waker: &Waker, deadline_ns: Option<u64>) {
        let began_ns = clock::now_ns();
        let credit = self.credit.load(Ordering::Relaxed);
        let was_worth_it = if credit > 0 {
            let limit_ns = (began_ns + LOOK_OUT_NS).min(deadline_ns.unwrap_or(u64::MAX));
            let is_woken = look_out(waker, limit_ns);
            // Returns at once where it is woken or the deadline is over.
            waker.wait_until(deadline_ns);
            is_woken
        } else {
            waker.wait_until(deadline_ns);
            clock::now_ns() - began_ns < SHORT_SLEEP_NS
        };
        let credit = if was_worth_it { (credit + 1).min(CREDIT_MAX) } else { credit.saturating_sub(1) };
        self.credit.store(credit, Ordering::Relaxed);
    }
}

/// True when it was woken before that moment.
fn look_out(waker: &Waker, limit_ns: u64) -> bool {
    loop {
        if waker.is_woken() {
            return true;
        }
        if clock::now_ns() >= limit_ns {
            return false;
        }
        std::hint::spin_loop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_waits_earn_credit_and_long_ones_cost_it() {
        let (lookout, waker) = (Lookout::default(), Waker::default());
        let credit = || lookout.credit.load(Ordering::Relaxed);
        for _ in 0..100 {
            waker.wake();
            lookout.wait_until(&waker, None);
        }
        assert_eq!(credit(), CREDIT_MAX);
        for left in (0..CREDIT_MAX).rev() {
            let deadline_ns = clock::now_ns() + 3 * SHORT_SLEEP_NS;
            lookout.wait_until(&waker, Some(deadline_ns));
            assert!(clock::now_ns() >= deadline_ns);
            assert_eq!(credit(), left);
        }
        lookout.wait_until(&waker, Some(clock::now_ns() + 3 * SHORT_SLEEP_NS));
        assert_eq!(credit(), 0);
    }
}
