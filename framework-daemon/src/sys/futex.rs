//! Waiting on a word of memory, and waking who waits. Async-signal-safe.
//!
//! The atomics are named here so that a model checker can put its own in their place (`tests/loom`).
#![allow(unsafe_code, reason = "address of unsafe: the futex system call")]

pub use std::sync::atomic::{AtomicPtr, AtomicU32, Ordering, fence};

use super::clock;

/// Waits while `word` holds `seen`, until woken or until `deadline_ns` on the monotonic clock (for ever without one). May
/// return without a reason: look again.
pub fn wait(word: &AtomicU32, seen: u32, deadline_ns: Option<u64>) {
    let deadline = deadline_ns.map(clock::timespec);
    let deadline = deadline.as_ref().map_or(std::ptr::null(), std::ptr::from_ref);
    // Absolute: no drift by the time between the clock's reading and the call.
    call(word, libc::FUTEX_WAIT_BITSET, seen, deadline, libc::FUTEX_BITSET_MATCH_ANY);
}

/// Wakes one thread that waits on `word`.
pub fn wake_one(word: &AtomicU32) {
    call(word, libc::FUTEX_WAKE, 1, std::ptr::null(), 0);
}

/// Lets other threads go on.
pub fn pause() {
    std::thread::yield_now();
}

fn call(word: &AtomicU32, operation: i32, value: u32, deadline: *const libc::timespec, bitset: i32) {
    // SAFETY: the word outlives the call, the deadline is null or points to a live timespec, and the unused second address
    // is null. Every error (woken, timed out, value changed) means: look again.
    unsafe {
        libc::syscall(
            libc::SYS_futex,
            word.as_ptr(),
            operation | libc::FUTEX_PRIVATE_FLAG,
            value,
            deadline,
            std::ptr::null::<u32>(),
            bitset,
        );
    }
}
