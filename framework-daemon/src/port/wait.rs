//! Who waits for whom. A slot waits for one other at most, so that the slots in a ring are a list that leads back to its
//! head: found before the last of them begins to wait.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use crossbeam_queue::SegQueue;

use crate::model::limits::WAITERS;
use crate::sys::clock;
use crate::sys::seat::{self, Note};

pub use crate::sys::fiber::{NotHere, park};

/// Where a wait takes place: what the time is there, and how whoever waits lets others run. Every function like [`park`]
/// is one, with the monotonic clock; a simulation brings a time of its own.
pub trait Place {
    /// Now, in nanoseconds.
    fn now_ns(&self) -> u64;

    /// The moment so many nanoseconds from now, or a little later where that is little beside them.
    fn in_ns(&self, time_ns: u64) -> u64 {
        self.now_ns().saturating_add(time_ns)
    }

    /// As [`park`].
    ///
    /// # Errors
    /// Where nobody may wait.
    fn park(&self, until_ns: u64) -> Result<(), NotHere>;
}

impl<F: Fn(u64) -> Result<(), NotHere>> Place for F {
    fn now_ns(&self) -> u64 {
        clock::now_ns()
    }

    /// To ask for the exact time takes as long as half a question and its answer.
    fn in_ns(&self, time_ns: u64) -> u64 {
        clock::in_ns(time_ns)
    }

    fn park(&self, until_ns: u64) -> Result<(), NotHere> {
        self(until_ns)
    }
}

/// By number: the number that it waits for; 0: none. Number 0 is nobody's.
static WAITS: [AtomicU32; WAITERS] = [const { AtomicU32::new(0) }; WAITERS];
static FREE: SegQueue<u32> = SegQueue::new();
static USED: AtomicU32 = AtomicU32::new(1);

/// A slot, as one that waits or is waited for.
#[derive(Debug)]
pub struct Waiter {
    number: u32,
    /// While it has tasks, it is in no ring: one of them may answer what its callbacks are asked, and they wait on their own.
    tasks: AtomicU32,
}

impl Waiter {
    /// One that waits for nobody. Beyond the bound its rings are not found: their waits end by their deadlines.
    #[must_use]
    pub fn new() -> Arc<Self> {
        let next = |used: u32| ((used as usize) < WAITERS).then_some(used + 1);
        let fresh = || USED.fetch_update(Ordering::AcqRel, Ordering::Acquire, next).ok();
        Arc::new(Self { number: FREE.pop().or_else(fresh).unwrap_or_default(), tasks: AtomicU32::new(0) })
    }

    /// It has one task more. Called where its callbacks are entered, between two stretches of them.
    pub fn task_began(&self) {
        self.tasks.fetch_add(1, Ordering::SeqCst);
        self.end();
    }

    /// It has one task less.
    pub fn task_ended(&self) {
        self.tasks.fetch_sub(1, Ordering::SeqCst);
    }

    /// It begins to wait for another one; false: it would wait for itself.
    #[must_use]
    pub fn begin(&self, other: &Self) -> bool {
        if self.number == 0 || self.tasks.load(Ordering::SeqCst) > 0 {
            return true;
        }
        // Told before the others are looked at: of those that close a ring at the same time the last one sees it.
        WAITS[self.number as usize].store(other.number, Ordering::SeqCst);
        let mut at = other.number;
        for _ in 0..WAITERS {
            if at == self.number {
                self.end();
                // A task that is about to begin may answer as well.
                return seat::is_left(Note::Spawned);
            }
            at = WAITS[at as usize].load(Ordering::SeqCst);
            if at == 0 {
                break;
            }
        }
        true
    }

    /// It waits for another one, which runs on its time: for those that would wait for it from there. Who waits beyond that
    /// begins to.
    pub fn note(&self, other: &Self) {
        if self.number != 0 && self.tasks.load(Ordering::Relaxed) == 0 {
            WAITS[self.number as usize].store(other.number, Ordering::Relaxed);
        }
    }

    /// It does not wait any more.
    pub fn end(&self) {
        WAITS[self.number as usize].store(0, Ordering::Release);
    }
}

impl Drop for Waiter {
    fn drop(&mut self) {
        self.end();
        if self.number != 0 {
            FREE.push(self.number);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_is_found_by_whoever_closes_it() {
        let [one, two, three] = [Waiter::new(), Waiter::new(), Waiter::new()];
        assert!(!one.begin(&one), "one's own service");
        assert!(one.begin(&two) && two.begin(&three));
        assert!(!three.begin(&one));
        two.end();
        assert!(three.begin(&one), "nothing leads back any more");
        assert!(!two.begin(&three));
    }

    #[test]
    fn one_whose_tasks_could_answer_closes_no_ring() {
        let [one, two] = [Waiter::new(), Waiter::new()];
        assert!(one.begin(&two));
        one.task_began();
        assert!(two.begin(&one), "what it waited for counts no more");
        assert!(one.begin(&two) && one.begin(&one), "a task of its own may answer");
        one.task_ended();
        assert!(!one.begin(&two));
    }

    #[test]
    fn a_number_is_used_again_and_waits_for_nobody_then() {
        let one = Waiter::new();
        let two = Waiter::new();
        assert!(one.begin(&two));
        let number = one.number;
        drop(one);
        assert_eq!(WAITS[number as usize].load(Ordering::SeqCst), 0);
    }
}
