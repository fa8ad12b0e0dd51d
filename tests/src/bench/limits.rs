//! The raw limits: `limits.c`, and a bare `catch_unwind`.
#![allow(unsafe_code, reason = "calls into C")]

use std::hint::black_box;
use std::panic::catch_unwind;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

mod c {
    unsafe extern "C" {
        pub(super) fn limit_trap(call: extern "C" fn()) -> u64;
        pub(super) fn limit_trap_and_write(fd: i32, bytes: *const u8, count: usize) -> u64;
        pub(super) fn limit_keep_on(thread: i32, processor: i32);
        pub(super) fn limit_watch_prepare();
        pub(super) fn limit_watchdog();
        pub(super) fn limit_watch_end();
        pub(super) fn limit_hang(budget: u64, call: extern "C" fn()) -> u64;
        pub(super) fn limit_copy(call: extern "C" fn(), to: *mut u64, from: *const u64, times: u64);
        pub(super) fn limit_wake(figures: *mut u64, rounds: u64, pause_ns: u64) -> i32;
    }
}

static CALLS: AtomicU64 = AtomicU64::new(0);

/// What is called at the end: the standby's first callback does something, too.
extern "C" fn call() {
    CALLS.fetch_add(1, Ordering::Relaxed);
}

/// SIGSEGV, `siglongjmp` without a mask, a call.
#[must_use]
pub fn trap() -> u64 {
    // SAFETY: the jump stays inside the C function, over no other frame than the handler's.
    unsafe { c::limit_trap(call) }
}

/// SIGSEGV, whose handler writes the bytes to a descriptor: nanoseconds until they are written.
#[must_use]
pub fn trap_and_write(fd: i32, bytes: &[u8]) -> u64 {
    // SAFETY: the bytes are valid for their length; the jump stays inside the C function, over no other frame than the handler's.
    unsafe { c::limit_trap_and_write(fd, bytes.as_ptr(), bytes.len()) }
}

/// A panic as deep as a provoked one, `catch_unwind`, a call.
///
/// # Panics
/// Never: what panics is caught.
#[must_use]
pub fn panic() -> u64 {
    let began = Instant::now();
    let caught = catch_unwind(|| {
        provoke(black_box(1));
        black_box(0)
    });
    call();
    let took = began.elapsed().as_nanos() as u64;
    assert!(caught.is_err());
    took
}

#[inline(never)]
fn provoke(code: u8) {
    assert!(black_box(code) != 1, "bare");
}

/// Keeps this process's threads of that name on that processor, where there is one; false: none has that name yet.
#[must_use]
pub fn keep_on(name: &str, processor: i32) -> bool {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let named = tasks.filter(|task| {
        let comm = std::fs::read_to_string(task.path().join("comm"));
        comm.is_ok_and(|comm| comm.trim_end() == name)
    });
    let threads = named.filter_map(|task| task.file_name().to_str()?.parse().ok());
    // SAFETY: takes no memory of ours.
    threads.map(|thread| unsafe { c::limit_keep_on(thread, processor) }).count() > 0
}

/// Makes ready for [`watchdog`] and [`hang`].
pub fn watch_prepare() {
    // SAFETY: called before its thread starts.
    unsafe { c::limit_watch_prepare() };
}

/// The body of the watchdog's thread.
pub fn watchdog() {
    // SAFETY: it was prepared.
    unsafe { c::limit_watchdog() };
}

/// Ends the watchdog's thread.
pub fn watch_end() {
    // SAFETY: it was prepared.
    unsafe { c::limit_watch_end() };
}

/// An endless loop, a watchdog that signals at the deadline, `siglongjmp`, a call: from the deadline on.
#[must_use]
pub fn hang(budget: Duration) -> u64 {
    // SAFETY: it was prepared; the jump stays inside the C function.
    unsafe { c::limit_hang(budget.as_nanos() as u64, call) }
}

/// An indirect call and the copy of 64 bytes, `times` times.
pub fn copy(times: u64) {
    let (from, mut to) = ([1u64; 8], [0u64; 8]);
    // SAFETY: both are eight words.
    unsafe { c::limit_copy(call, to.as_mut_ptr(), from.as_ptr(), times) };
    black_box(to);
}

/// From a futex wake on one processor to the first instruction on another, that many times, each after a pause of less than a
/// second.
///
/// # Panics
/// When the system has no thread left.
#[must_use]
pub fn wake(rounds: usize, pause: Duration) -> Vec<u64> {
    let mut figures = vec![0; rounds];
    // SAFETY: there is room for that many.
    let done = unsafe { c::limit_wake(figures.as_mut_ptr(), rounds as u64, pause.as_nanos() as u64) };
    assert!(done != 0, "there is a second thread");
    figures
}
