//! Input ports. The newest value only (OPRoS LAST) is a queue of one whose oldest makes room; a FIFO is a longer one.
//! Both are one lock-free ring, so that any number of writers never wait for a reader or for each other.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use component_sdk::abi::payload::{ReadMode, ReadResult};
use component_sdk::object::TypeDescriptor;
use crossbeam_queue::ArrayQueue;

use super::block::Sample;
use super::check::Checks;
use crate::model::limits::FIFO_SIZE_MAX;
use crate::profile::plan::{Overflow, Queue};

/// Told when data arrives: wakes a nonperiodic slot.
pub trait Listener: Send + Sync {
    /// Called by the writer's thread; must not block.
    fn data_arrived(&self);
}

/// An input port of a slot.
pub struct InPort {
    /// Name.
    pub name: String,
    /// What it carries.
    pub object: &'static TypeDescriptor,
    /// Checks of the port itself.
    pub checks: Checks,
    queue: ArrayQueue<Sample>,
    policy: Queue,
    // Taken by the reader only, for a few instructions; writers never touch it. Nothing is dropped under it: the last
    // holder of an object frees the memory of a plugin.
    current: Mutex<Option<Sample>>,
    listener: OnceLock<Box<dyn Listener>>,
    received: AtomicU64,
    dropped: AtomicU64,
}

impl InPort {
    /// An unconnected port.
    #[must_use]
    pub fn new(name: &str, object: &'static TypeDescriptor, policy: Queue, checks: Checks) -> Self {
        let capacity = match policy {
            Queue::Last => 1,
            Queue::Fifo { size, .. } => size.clamp(1, FIFO_SIZE_MAX),
        };
        Self {
            name: name.to_owned(),
            object,
            checks,
            queue: ArrayQueue::new(capacity),
            policy,
            current: Mutex::new(None),
            listener: OnceLock::new(),
            received: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
        }
    }

    /// Sets who is told of arriving data; once.
    pub fn listen(&self, listener: Box<dyn Listener>) {
        let _ = self.listener.set(listener);
    }

    /// How it buffers.
    #[must_use]
    pub const fn policy(&self) -> Queue {
        self.policy
    }

    /// How many blocks this port can hold: what is queued, and what its reader looks at.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.queue.capacity() + 1
    }

    /// True when something waits to be read.
    #[must_use]
    pub fn has_data(&self) -> bool {
        !self.queue.is_empty()
    }

    /// Values that wait to be read.
    #[must_use]
    pub fn queued(&self) -> usize {
        self.queue.len()
    }

    /// Values received and values lost to a full queue.
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        (self.received.load(Ordering::Relaxed), self.dropped.load(Ordering::Relaxed))
    }

    /// Takes a value in; false: it, or one that may not be lost, was lost.
    pub(super) fn push(&self, sample: Sample) -> Pushed {
        let pushed = match self.policy {
            Queue::Last => {
                self.queue.force_push(sample);
                Pushed::Kept
            }
            Queue::Fifo { overflow: Overflow::DropOldest, .. } => match self.queue.force_push(sample) {
                Some(_) => self.lost(Pushed::OldestLost),
                None => Pushed::Kept,
            },
            Queue::Fifo { overflow, .. } => match self.queue.push(sample) {
                Ok(()) => Pushed::Kept,
                Err(_) if overflow == Overflow::Fault => self.lost(Pushed::Overload),
                Err(_) => self.lost(Pushed::NewestLost),
            },
        };
        self.received.fetch_add(1, Ordering::Relaxed);
        if let Some(listener) = self.listener.get() {
            listener.data_arrived();
        }
        pushed
    }

    fn lost(&self, how: Pushed) -> Pushed {
        self.dropped.fetch_add(1, Ordering::Relaxed);
        how
    }

    /// Reads; the object stays valid until the next read.
    pub(super) fn read(&self, mode: ReadMode) -> ReadResult {
        let next = match mode {
            ReadMode::Take => self.queue.pop(),
            ReadMode::Newest | ReadMode::Fresh => std::iter::from_fn(|| self.queue.pop()).last(),
        };
        if next.is_none() && mode != ReadMode::Newest {
            return ReadResult::NONE;
        }
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        let before = next.and_then(|sample| current.replace(sample));
        let result = current
            .as_ref()
            .map_or(ReadResult::NONE, |sample| ReadResult { value: sample.value(), stamp_ns: sample.stamp_ns() });
        drop(current);
        drop(before);
        result
    }
}

/// What became of a value at a reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// It is there.
    Kept,
    /// It is there; the oldest made room.
    OldestLost,
    /// It was lost.
    NewestLost,
    /// It was lost where nothing may be.
    Overload,
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::Arc;

    use component_sdk::object::CommObject;
    use proptest::prelude::*;

    use super::super::block::Block;
    use super::*;

    fn sample(value: u64) -> Sample {
        let block = Block::new(u64::DESCRIPTOR);
        block.fill(value);
        Arc::new(block)
    }

    fn port(policy: Queue) -> InPort {
        InPort::new("in", u64::DESCRIPTOR, policy, Checks::default())
    }

    #[test]
    fn the_newest_value_may_be_read_again() {
        let port = port(Queue::Last);
        assert!(port.read(ReadMode::Newest).value.is_null());
        port.push(sample(1));
        port.push(sample(2));
        assert_eq!(port.read(ReadMode::Fresh).stamp_ns, 2);
        assert!(port.read(ReadMode::Fresh).value.is_null());
        assert_eq!(port.read(ReadMode::Newest).stamp_ns, 2);
    }

    proptest! {
        /// A FIFO of each overflow rule against a `VecDeque`.
        #[test]
        fn a_fifo_keeps_order_and_counts_losses(size in 1..6usize, rule in 0..3usize, steps in prop::collection::vec(any::<bool>(), 0..100)) {
            let overflow = [Overflow::DropOldest, Overflow::DropNewest, Overflow::Fault][rule];
            let port = port(Queue::Fifo { size, overflow });
            let (mut model, mut lost) = (VecDeque::new(), 0);
            for (number, write) in (1u64..).zip(steps) {
                if write {
                    port.push(sample(number));
                    if model.len() == size {
                        lost += 1;
                        if overflow != Overflow::DropOldest { continue; }
                        model.pop_front();
                    }
                    model.push_back(number);
                } else {
                    let read = port.read(ReadMode::Take);
                    prop_assert_eq!((!read.value.is_null()).then_some(read.stamp_ns), model.pop_front());
                }
            }
            prop_assert_eq!(port.counts().1, lost);
        }
    }
}
