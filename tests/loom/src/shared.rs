//! `sys::shared` for the checker. Its queue is a list behind a lock: whoever takes something out sees all that was done
//! before it was put in, and whoever finds nothing is seen by whoever puts something in later, as with the real one.

use std::collections::VecDeque;
use std::sync::PoisonError;

pub use loom::sync::atomic::{AtomicBool, AtomicPtr, AtomicU8, AtomicU32, AtomicU64, AtomicUsize, Ordering};
pub use loom::sync::{Mutex, MutexGuard};

/// A queue with a bound.
pub struct ArrayQueue<T> {
    room: usize,
    list: Mutex<VecDeque<T>>,
}

impl<T> ArrayQueue<T> {
    /// An empty one.
    #[must_use]
    pub fn new(room: usize) -> Self {
        Self { room, list: Mutex::new(VecDeque::new()) }
    }

    fn list(&self) -> MutexGuard<'_, VecDeque<T>> {
        self.list.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts something in.
    ///
    /// # Errors
    /// The same, where there is no room.
    pub fn push(&self, item: T) -> Result<(), T> {
        let mut list = self.list();
        if list.len() >= self.room {
            return Err(item);
        }
        list.push_back(item);
        Ok(())
    }

    /// Takes the first out.
    pub fn pop(&self) -> Option<T> {
        self.list().pop_front()
    }

    /// True when nothing is in it.
    pub fn is_empty(&self) -> bool {
        self.list().is_empty()
    }

    /// How much is in it.
    pub fn len(&self) -> usize {
        self.list().len()
    }
}
