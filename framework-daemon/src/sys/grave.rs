//! What becomes of the stacks of fibers that were ended. Their addresses are never used again, because a thread that the
//! component started may still hold some.
//!
//! A fresh mapping is laid over them, which gives pages and page tables back, cannot be read or written, and merges with its
//! neighbours into one: with `madvise` and `mprotect` each grave would be a mapping of its own, and 20,000 reach the kernel's
//! limit. But it makes each processor forget where this process's memory lies, code included. Done at once, after each fault, the
//! next recovery took twice as long where the spare was made on another processor, and every other executor paid for it, too. So
//! graves are kept, and levelled many at a time by an ordinary thread.
#![allow(unsafe_code, reason = "address of unsafe: mappings")]

use std::ops::Range;
use std::ptr::without_provenance_mut;
use std::sync::{Mutex, PoisonError};

use super::stack::RESERVED;
use crate::model::limits::{GRAVE_BYTES, GRAVES};

/// Those beyond are levelled at once: nobody else does.
const PLACES: usize = 2 * GRAVES;

struct Kept {
    ranges: [(usize, usize); PLACES],
    count: usize,
    bytes: usize,
}

static KEPT: Mutex<Kept> = Mutex::new(Kept { ranges: [(0, 0); PLACES], count: 0, bytes: 0 });

/// Leaves a stack, of which so many bytes may be in memory, to [`level_many`]. Where those are too many, its pages are given back
/// now.
///
/// # Safety
/// The range must be that of an [`super::stack::OwnStack`] on which nothing runs any more and which is never dropped.
pub(super) unsafe fn entomb(range: Range<usize>, bytes: usize) {
    if !keep(&range, bytes) {
        // SAFETY: the caller's promise.
        unsafe { level(range) };
    }
}

/// Levels those that are kept, where they are many. All processors forget where memory lies.
pub fn level_many() {
    let (mut ranges, count) = {
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.count < GRAVES && kept.bytes < GRAVE_BYTES {
            return;
        }
        kept.bytes = 0;
        (kept.ranges, std::mem::take(&mut kept.count))
    };
    for run in runs(&mut ranges[..count]) {
        // SAFETY: what `entomb` was given, each once.
        unsafe { level(run) };
    }
}

/// False: there is no room, or somebody else is at it.
fn keep(range: &Range<usize>, bytes: usize) -> bool {
    let Ok(mut kept) = KEPT.try_lock() else { return false };
    let (count, bytes) = (kept.count, kept.bytes.saturating_add(bytes));
    let has_room = count < PLACES && bytes <= 2 * GRAVE_BYTES;
    if has_room {
        kept.ranges[count] = (range.start, range.end);
        (kept.count, kept.bytes) = (count + 1, bytes);
    }
    has_room
}

/// Ranges side by side are one.
fn runs(ranges: &mut [(usize, usize)]) -> impl Iterator<Item = Range<usize>> {
    ranges.sort_unstable();
    ranges.chunk_by(|below, above| below.1 == above.0).map(|run| run[0].0..run[run.len() - 1].1)
}

/// # Safety
/// As of [`entomb`], of each stack in the range.
unsafe fn level(range: Range<usize>) {
    let start = without_provenance_mut(range.start);
    // SAFETY: the caller's promise.
    unsafe { libc::mmap(start, range.len(), libc::PROT_NONE, RESERVED | libc::MAP_FIXED, -1, 0) };
}

#[cfg(test)]
mod tests {
    use std::mem::ManuallyDrop;

    use proptest::prelude::*;

    use super::super::peek::Peek;
    use super::super::stack::OwnStack;
    use super::*;

    fn entombed(bytes: usize) -> usize {
        let stack = ManuallyDrop::new(OwnStack::new(64 << 10).unwrap());
        let top = stack.range().end - 8;
        // SAFETY: the stack is ours to write; nothing runs on it, and it is never dropped.
        unsafe {
            without_provenance_mut::<u64>(top).write_volatile(7);
            entomb(stack.range(), bytes);
        }
        top
    }

    fn is_there(address: usize) -> bool {
        Peek::default().at(address, 8).is_some()
    }

    #[test]
    fn large_graves_are_levelled_at_once_and_others_when_they_are_many() {
        assert!(!is_there(entombed(usize::MAX)));
        let tops: Vec<_> = (0..3 * PLACES).map(|_| entombed(64 << 10)).collect();
        assert!(tops.iter().filter(|top| is_there(**top)).count() <= PLACES);
        level_many();
        assert!(tops.iter().filter(|top| is_there(**top)).count() < GRAVES);
    }

    proptest! {
        #[test]
        fn runs_cover_what_they_are_made_of_and_nothing_else(places in prop::collection::btree_set(0usize..40, 0..30)) {
            let mut ranges: Vec<_> = places.iter().rev().map(|place| (place * 2, place * 2 + 2)).collect();
            let runs: Vec<_> = runs(&mut ranges).collect();
            let covered: Vec<_> = runs.iter().cloned().flatten().collect();
            prop_assert_eq!(covered, places.iter().flat_map(|place| [place * 2, place * 2 + 1]).collect::<Vec<_>>());
            prop_assert!(runs.windows(2).all(|pair| pair[0].end < pair[1].start));
        }
    }
}
