//! Tasks, as far as others need to reach them: how many an instance has, and the wakers of a slot's.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use super::wake::Waker;
use crate::model::limits::TASKS;

/// Places in a slot: those of its instance, and those of an earlier one that could not be ended.
const PLACES: usize = 2 * TASKS;

const _: () = assert!(PLACES <= 32, "a bit for each");

/// Wakers of a slot's tasks.
#[derive(Debug, Default)]
pub struct Crowd {
    taken: AtomicU32,
    wakers: OnceLock<Box<[Waker; PLACES]>>,
}

impl Crowd {
    /// A place for a task; `None`: there is none left.
    pub fn join(&self) -> Option<usize> {
        self.wakers.get_or_init(Box::default);
        let free = |taken: u32| 1u32.checked_shl(taken.trailing_ones()).map(|place| taken | place);
        let before = self.taken.fetch_update(Ordering::SeqCst, Ordering::SeqCst, free).ok()?;
        Some(before.trailing_ones() as usize)
    }

    /// The place is free again.
    pub fn leave(&self, place: usize) {
        self.taken.fetch_and(!(1 << place), Ordering::SeqCst);
    }

    /// Wakes every task: what one of them waits for may be there.
    #[inline]
    pub fn wake_all(&self) {
        let taken = self.taken.load(Ordering::SeqCst);
        if taken != 0 {
            (0..PLACES).filter(|place| taken & 1 << place != 0).for_each(|place| self.wake(place));
        }
    }

    /// Wakes the task in that place.
    pub fn wake(&self, place: usize) {
        self.waker(place).into_iter().for_each(Waker::wake);
    }

    /// The task in that place waits until it is woken, or until then.
    pub fn wait(&self, place: usize, until_ns: Option<u64>) {
        self.waker(place).into_iter().for_each(|waker| waker.wait_until(until_ns));
    }

    fn waker(&self, place: usize) -> Option<&Waker> {
        self.wakers.get()?.get(place)
    }
}

/// By instance: how many tasks it has. Only those that have any, so that few are looked through.
static COUNTS: Mutex<Vec<(u64, usize)>> = Mutex::new(Vec::new());

/// The instance has one task more; false: it has as many as it may.
#[must_use]
pub fn claim(instance: u64) -> bool {
    let mut counts = COUNTS.lock().unwrap_or_else(PoisonError::into_inner);
    match counts.iter_mut().find(|(known, _)| *known == instance) {
        Some((_, count)) if *count >= TASKS => return false,
        Some((_, count)) => *count += 1,
        None => counts.push((instance, 1)),
    }
    true
}

/// The instance has one task less.
pub fn release(instance: u64) {
    let mut counts = COUNTS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(index) = counts.iter().position(|(known, _)| *known == instance) {
        counts[index].1 -= 1;
        if counts[index].1 == 0 {
            counts.swap_remove(index);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_taken_once_and_used_again() {
        let crowd = Crowd::default();
        crowd.wake_all();
        let places: Vec<_> = std::iter::from_fn(|| crowd.join()).collect();
        assert_eq!(places, (0..PLACES).collect::<Vec<_>>());
        crowd.leave(7);
        assert_eq!((crowd.join(), crowd.join()), (Some(7), None));
        crowd.wake_all();
        // Woken before: it does not wait.
        places.iter().for_each(|place| crowd.wait(*place, None));
    }

    #[test]
    fn an_instance_has_no_more_than_it_may() {
        let instance = u64::MAX - 77;
        assert!((0..TASKS).all(|_| claim(instance)) && !claim(instance));
        release(instance);
        assert!(claim(instance) && !claim(instance));
        (0..TASKS).for_each(|_| release(instance));
        release(instance);
        assert!(COUNTS.lock().unwrap().iter().all(|(known, _)| *known != instance));
    }
}
