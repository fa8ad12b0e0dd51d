//! Which messages of the crowd were accepted, and which were taken: each of them once.

use std::sync::atomic::{AtomicU64, Ordering};

/// Numbers that can be told apart.
const NUMBERS: usize = 1 << 22;

static SENT: AtomicU64 = AtomicU64::new(0);
static TAKEN: AtomicU64 = AtomicU64::new(0);
static SEEN: [AtomicU64; NUMBERS / 64] = [const { AtomicU64::new(0) }; NUMBERS / 64];

/// One was accepted.
pub(crate) fn sent() {
    SENT.fetch_add(1, Ordering::SeqCst);
}

/// One was taken; false: for the second time.
pub(crate) fn taken(number: u64) -> bool {
    let (word, bit) = (number as usize / 64 % SEEN.len(), 1 << (number % 64));
    let is_first = SEEN[word].fetch_or(bit, Ordering::SeqCst) & bit == 0;
    TAKEN.fetch_add(1, Ordering::SeqCst);
    is_first
}

/// How many were accepted, and how many were taken.
pub(crate) fn both() -> (u64, u64) {
    (SENT.load(Ordering::SeqCst), TAKEN.load(Ordering::SeqCst))
}
