//! How an executor that has nothing to do waits: it looks out for a moment before it sleeps, where that was worth it lately.
//!
//! To fall asleep and to be woken takes two threads some ten microseconds, many times what a hop takes otherwise. To look out
//! for as long as that costs at most twice what the better choice would have (Karlin et al. 1990, competitive spinning); and
//! to do so only while waits prove to be that short costs nothing where they are not: executors of periodic components sleep
//! at once. To look out always was the alternative: it takes a processor that others need.
//!
//! What it takes to be woken differs from machine to machine, from five microseconds to fifty, and is found out while it happens:
//! a constant of ten was there before, and executors on a virtual machine slept a hundred times for each time that was worth it.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use super::clock;
use super::wake::Waker;
use crate::model::limits::{LOOK_OUT_LEAST, LOOK_OUT_MOST};
use crate::model::time::nanoseconds;

const LEAST_NS: u64 = nanoseconds(LOOK_OUT_LEAST);
const MOST_NS: u64 = nanoseconds(LOOK_OUT_MOST);
/// Times that it may be in vain, one after the other.
const CREDIT_MAX: u32 = 4;

/// What was found out about the waits of one thread. Written by it alone, but for when it was rung for.
#[derive(Debug)]
pub struct Lookout {
    credit: AtomicU32,
    /// What it takes to be woken, in nanoseconds: so long it looks out.
    cost_ns: AtomicU64,
    /// When it was woken last, as long as it has not noticed; 0: it was not.
    rung_ns: AtomicU64,
}

impl Default for Lookout {
    fn default() -> Self {
        Self { credit: AtomicU32::new(0), cost_ns: AtomicU64::new(LEAST_NS), rung_ns: AtomicU64::new(0) }
    }
}

impl Lookout {
    /// Wakes whoever waits here.
    pub fn wake(&self, waker: &Waker) {
        if waker.is_waited_for() {
            self.rung_ns.store(clock::now_ns(), Ordering::Relaxed);
        }
        waker.wake();
    }

    /// Waits for a wake-up or the deadline.
    pub fn wait_until(&self, waker: &Waker, deadline_ns: Option<u64>) {
        let began_ns = clock::now_ns();
        let credit = self.credit.load(Ordering::Relaxed);
        let cost_ns = self.cost_ns.load(Ordering::Relaxed);
        let was_worth_it = if credit > 0 {
            let limit_ns = (began_ns + cost_ns).min(deadline_ns.unwrap_or(u64::MAX));
            let is_woken = look_out(waker, limit_ns);
            // Returns at once where it is woken or the deadline is over.
            self.sleep_until(waker, deadline_ns);
            is_woken
        } else {
            // A sleep that is over so soon: to look out would have been better.
            self.sleep_until(waker, deadline_ns) - began_ns < 2 * cost_ns
        };
        let credit = if was_worth_it { (credit + 1).min(CREDIT_MAX) } else { credit.saturating_sub(1) };
        self.credit.store(credit, Ordering::Relaxed);
    }

    /// Sleeps, if nobody has rung; returns when that is over.
    fn sleep_until(&self, waker: &Waker, deadline_ns: Option<u64>) -> u64 {
        waker.wait_until(deadline_ns);
        let now_ns = clock::now_ns();
        let rung_ns = self.rung_ns.load(Ordering::Relaxed);
        if rung_ns != 0 {
            self.rung_ns.store(0, Ordering::Relaxed);
            self.learn(now_ns.saturating_sub(rung_ns));
        }
        now_ns
    }

    /// Follows what is found quickly to the short ones and slowly to the long ones: in those others had the processor.
    fn learn(&self, took_ns: u64) {
        let cost_ns = self.cost_ns.load(Ordering::Relaxed);
        let next_ns = if took_ns < cost_ns {
            cost_ns - (cost_ns - took_ns) / 4
        } else {
            cost_ns + (took_ns - cost_ns).min(MOST_NS) / 16
        };
        self.cost_ns.store(next_ns.clamp(LEAST_NS, MOST_NS), Ordering::Relaxed);
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
            let deadline_ns = clock::now_ns() + 6 * MOST_NS;
            lookout.wait_until(&waker, Some(deadline_ns));
            assert!(clock::now_ns() >= deadline_ns);
            assert_eq!(credit(), left);
        }
        lookout.wait_until(&waker, Some(clock::now_ns() + 6 * MOST_NS));
        assert_eq!(credit(), 0);
    }

    #[test]
    fn it_looks_out_as_long_as_it_takes_to_be_woken_within_bounds() {
        let lookout = Lookout::default();
        let after = |took_ns: u64| {
            (0..200).for_each(|_| lookout.learn(took_ns));
            lookout.cost_ns.load(Ordering::Relaxed)
        };
        assert!(after(30_000).abs_diff(30_000) < 100);
        assert_eq!(after(10_000_000), MOST_NS);
        assert!(after(20_000).abs_diff(20_000) < 100);
        assert_eq!(after(1_000), LEAST_NS);
        // Four long ones for each short one: nearer to the short one.
        for round in 0..1_000 {
            lookout.learn(if round % 5 == 0 { 12_000 } else { 40_000 });
        }
        let cost_ns = lookout.cost_ns.load(Ordering::Relaxed);
        assert!((12_000..30_000).contains(&cost_ns), "{cost_ns}");
    }

    #[test]
    fn who_is_woken_learns_what_that_took() {
        let (lookout, waker) = (Lookout::default(), Waker::default());
        lookout.wake(&waker);
        assert_eq!(lookout.rung_ns.load(Ordering::Relaxed), 0, "nobody waited");
        lookout.wait_until(&waker, None);
        lookout.rung_ns.store(clock::now_ns() - 10 * MOST_NS, Ordering::Relaxed);
        lookout.wait_until(&waker, Some(clock::now_ns()));
        assert_eq!(lookout.rung_ns.load(Ordering::Relaxed), 0);
        assert!(lookout.cost_ns.load(Ordering::Relaxed) > LEAST_NS);
    }
}
