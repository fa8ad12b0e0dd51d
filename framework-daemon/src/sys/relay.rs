//! The hand-over of an executor: a thread that is given up passes the fiber that it was running, a reserve thread takes it.
//!
//! Passing happens in a signal handler: no allocation, no lock. What is passed is seen whole by whoever takes it, exactly
//! one thread takes it, and no wake-up is lost; the model checker goes through all interleavings (`tests/loom`).

use super::futex::{self, AtomicPtr, AtomicU32, Ordering};

/// Places for what is passed and not taken yet; each costs a word.
const PLACES: usize = 64;

/// Between threads that are given up and those in reserve, for one schedule.
pub struct Relay<T, const N: usize = PLACES> {
    places: [AtomicPtr<T>; N],
    /// Changes with each passing: who found nothing waits for the next.
    passed: AtomicU32,
}

impl<T, const N: usize> Default for Relay<T, N> {
    fn default() -> Self {
        Self { places: std::array::from_fn(|_| AtomicPtr::new(std::ptr::null_mut())), passed: AtomicU32::new(0) }
    }
}

impl<T, const N: usize> Relay<T, N> {
    /// Passes `work` on; false: more is waiting already than anybody could take.
    pub fn pass(&self, work: *mut T) -> bool {
        let free = |place: &&AtomicPtr<T>| {
            place.compare_exchange(std::ptr::null_mut(), work, Ordering::Release, Ordering::Relaxed).is_ok()
        };
        let found = self.places.iter().find(free).is_some();
        if found {
            self.passed.fetch_add(1, Ordering::Release);
            futex::wake_one(&self.passed);
        }
        found
    }

    /// Waits for work.
    pub fn take(&self) -> *mut T {
        loop {
            let seen = self.passed.load(Ordering::Acquire);
            let mut found = self.places.iter().map(|place| place.swap(std::ptr::null_mut(), Ordering::Acquire));
            match found.find(|work| !work.is_null()) {
                Some(work) => return work,
                None => futex::wait(&self.passed, seen, None),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn each_piece_of_work_is_taken_once() {
        let relay = Arc::new(Relay::<u64>::default());
        let takers: Vec<_> = (0..4)
            .map(|_| {
                let relay = Arc::clone(&relay);
                std::thread::spawn(move || (0..25).map(|_| relay.take().addr()).collect::<Vec<_>>())
            })
            .collect();
        for number in 1..=100usize {
            while !relay.pass(std::ptr::without_provenance_mut(number)) {
                std::thread::yield_now();
            }
        }
        let mut taken: Vec<_> = takers.into_iter().flat_map(|taker| taker.join().unwrap()).collect();
        taken.sort_unstable();
        assert_eq!(taken, (1..=100).collect::<Vec<_>>());
    }
}
