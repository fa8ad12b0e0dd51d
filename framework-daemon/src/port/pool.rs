//! The blocks of an output port: one on loan, some with readers, the others free.
//!
//! Used by one thread at a time without a lock: that of the callbacks of the port's slot. Another thread may only add blocks,
//! when it connects a reader; they are never taken away. What is kept in here may be half-changed when a thread is given up: every
//! word stands for itself.

use std::sync::atomic::{AtomicUsize, Ordering, fence};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use component_sdk::abi::payload::LoanResult;
use component_sdk::object::TypeDescriptor;

use super::block::{Block, Sample};

/// Places in the first segment; each further one has twice as many.
const FIRST: usize = 8;
const SEGMENTS: usize = 28;
/// Nothing is on loan.
const NOTHING: usize = usize::MAX;

/// What becomes of a loan that was never returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lost {
    /// Its borrower is gone: the block is lent again, empty.
    Again,
    /// Its borrower may still write: the block is never lent again.
    Never,
}

type Segment = Box<[OnceLock<Sample>]>;

/// Blocks for objects of one type.
pub(super) struct Pool {
    object: &'static TypeDescriptor,
    lost: Lost,
    segments: [OnceLock<Segment>; SEGMENTS],
    count: AtomicUsize,
    cursor: AtomicUsize,
    on_loan: AtomicUsize,
    growing: Mutex<()>,
}

impl Pool {
    pub(super) const fn new(object: &'static TypeDescriptor, lost: Lost) -> Self {
        Self {
            object,
            lost,
            segments: [const { OnceLock::new() }; SEGMENTS],
            count: AtomicUsize::new(0),
            cursor: AtomicUsize::new(0),
            on_loan: AtomicUsize::new(NOTHING),
            growing: Mutex::new(()),
        }
    }

    /// Sees to it that there are as many blocks. Any thread.
    pub(super) fn grow_to(&self, wanted: usize) {
        if self.count.load(Ordering::Acquire) >= wanted {
            return;
        }
        let _growing = self.growing.lock().unwrap_or_else(PoisonError::into_inner);
        while self.count.load(Ordering::Relaxed) < wanted {
            self.add();
        }
    }

    fn add(&self) {
        let index = self.count.load(Ordering::Relaxed);
        let (segment, offset) = place(index);
        let segment = self.segments[segment].get_or_init(|| (0..FIRST << segment).map(|_| OnceLock::new()).collect());
        let _ = segment[offset].set(Arc::new(Block::new(self.object)));
        self.count.store(index + 1, Ordering::Release);
    }

    #[inline]
    fn get(&self, index: usize) -> Option<&Sample> {
        let (segment, offset) = place(index);
        self.segments.get(segment)?.get()?.get(offset)?.get()
    }

    /// Lends a block that no reader holds.
    #[inline]
    pub(super) fn lend(&self) -> LoanResult {
        self.forget_lost_loan();
        let (index, block) = self.free();
        self.on_loan.store(index, Ordering::Relaxed);
        LoanResult { value: block.value(), initialised: block.is_filled() }
    }

    /// True of one of its blocks.
    pub(super) fn has(&self, sample: &Sample) -> bool {
        (0..self.count.load(Ordering::Acquire)).any(|index| self.get(index).is_some_and(|own| Arc::ptr_eq(own, sample)))
    }

    /// The block on loan, if that is where its value lies.
    #[inline]
    pub(super) fn lent(&self, value: *mut u8) -> Option<&Sample> {
        let sample = match self.on_loan.load(Ordering::Relaxed) {
            NOTHING => None,
            index => self.get(index),
        };
        sample.filter(|sample| sample.value() == value)
    }

    /// The block on loan, which is not any more. Whatever `value` is, nothing is on loan afterwards.
    #[inline]
    pub(super) fn end_loan(&self, value: *mut u8) -> Option<&Sample> {
        let sample = self.lent(value);
        self.on_loan.store(NOTHING, Ordering::Relaxed);
        sample
    }

    /// A loan that was never returned belonged to a callback that a trap ended, or to a thread: what lies in its block is
    /// half-written, so it is neither read nor dropped.
    pub(super) fn forget_lost_loan(&self) {
        let index = self.on_loan.load(Ordering::Relaxed);
        let Some(sample) = (index != NOTHING).then(|| self.get(index)).flatten() else { return };
        self.on_loan.store(NOTHING, Ordering::Relaxed);
        sample.forget_contents();
        if self.lost == Lost::Never {
            // Held by nobody for ever: it is never free again, and never freed.
            #[allow(clippy::mem_forget, reason = "a thread that the component started may still write it")]
            std::mem::forget(Arc::clone(sample));
        }
    }

    /// A block that only this pool holds; a new one where readers hold more than they may.
    #[inline]
    fn free(&self) -> (usize, &Sample) {
        let count = self.count.load(Ordering::Acquire);
        let mut index = self.cursor.load(Ordering::Relaxed);
        for _ in 0..count {
            if index >= count {
                index = 0;
            }
            if let Some(sample) = self.get(index)
                && Arc::strong_count(sample) == 1
            {
                // What the last reader did with it is over before it is written.
                fence(Ordering::Acquire);
                self.cursor.store(index + 1, Ordering::Relaxed);
                return (index, sample);
            }
            index += 1;
        }
        self.grow_to(count + 1);
        self.free()
    }
}

impl Drop for Pool {
    /// A block on loan may hold half an object, which nobody may drop.
    fn drop(&mut self) {
        self.forget_lost_loan();
    }
}

/// Segment and place in it.
#[inline]
const fn place(index: usize) -> (usize, usize) {
    let number = index + FIRST;
    let segment = (number.ilog2() - FIRST.ilog2()) as usize;
    (segment, number - (FIRST << segment))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_block_has_one_place() {
        let places: Vec<_> = (0..100).map(place).collect();
        assert_eq!(places[..2], [(0, 0), (0, 1)]);
        assert_eq!((places[7], places[8], places[23], places[24]), ((0, 7), (1, 0), (1, 15), (2, 0)));
        assert!(places.iter().all(|(segment, offset)| *offset < FIRST << segment));
    }
}
