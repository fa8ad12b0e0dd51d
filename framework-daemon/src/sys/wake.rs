//! Waiting for a moment on the monotonic clock or a wake-up, whichever comes first.
//!
//! A futex with an absolute deadline. A channel's blocking `recv` was measured first: crossbeam's yields four times
//! before it parks, and beside any runnable thread its p99 is milliseconds.

use super::futex::{self, AtomicU32, Ordering};

/// Nobody waits, nothing happened.
const IDLE: u32 = 0;
/// A thread waits.
const WAITING: u32 = 1;
/// Woken; the next wait returns at once.
const WOKEN: u32 = 2;

/// One thread waits, any thread wakes it. A wake-up is remembered until the next wait.
#[derive(Debug, Default)]
pub struct Waker(AtomicU32);

impl Waker {
    /// Wakes the waiting thread, or makes its next wait return at once.
    pub fn wake(&self) {
        if self.0.swap(WOKEN, Ordering::AcqRel) == WAITING {
            futex::wake_one(&self.0);
        }
    }

    /// True when the next wait returns at once.
    #[must_use]
    pub fn is_woken(&self) -> bool {
        self.0.load(Ordering::Relaxed) == WOKEN
    }

    /// True while a thread waits.
    #[must_use]
    pub fn is_waited_for(&self) -> bool {
        self.0.load(Ordering::Relaxed) == WAITING
    }

    /// Waits until `deadline_ns` on the monotonic clock (for ever without one) or until woken.
    pub fn wait_until(&self, deadline_ns: Option<u64>) {
        if self.0.compare_exchange(IDLE, WAITING, Ordering::AcqRel, Ordering::Acquire).is_ok() {
            futex::wait(&self.0, WAITING, deadline_ns);
        }
        // Also acquires what a waker published in the moment between time-out and here.
        self.0.swap(IDLE, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::clock;
    use super::*;

    #[test]
    fn a_wake_up_before_the_wait_is_remembered() {
        let waker = Waker::default();
        waker.wake();
        waker.wait_until(None);
    }

    #[test]
    fn a_deadline_ends_the_wait() {
        let waker = Waker::default();
        let deadline = clock::now_ns() + 5_000_000;
        waker.wait_until(Some(deadline));
        assert!(clock::now_ns() >= deadline);
    }

    #[test]
    fn no_wake_up_is_lost() {
        let waker = Arc::new(Waker::default());
        let count = Arc::new(AtomicU32::new(0));
        let thread = std::thread::spawn({
            let (waker, count) = (Arc::clone(&waker), Arc::clone(&count));
            move || {
                for _ in 0..10_000 {
                    count.fetch_add(1, Ordering::SeqCst);
                    waker.wake();
                }
            }
        });
        while count.load(Ordering::SeqCst) < 10_000 {
            waker.wait_until(None);
        }
        thread.join().unwrap();
    }
}
