//! The monotonic clock, in nanoseconds. Wall time is for display only.
#![allow(unsafe_code, reason = "address of unsafe: the clocks' system call")]

use std::cell::Cell;

/// By how much [`recent_ns`] may lie in the past, in nanoseconds, as far as its thread is let run: the longest tick of the kernel.
pub const TICK_NS: u64 = 10_000_000;

thread_local! {
    // `const` and without destructor: signal handlers may read the clock at any moment.
    static LAST: Cell<u64> = const { Cell::new(0) };
}

/// `CLOCK_MONOTONIC` now. Async-signal-safe. Not inlined: the thread may be another one after a callback, and nobody may
/// keep the address of a thread-local.
#[must_use]
#[inline(never)]
pub fn now_ns() -> u64 {
    let now = read(libc::CLOCK_MONOTONIC);
    LAST.set(now);
    now
}

/// A moment ago, on the same clock: the last time that this thread read it, or the last tick of the kernel (1 to 10 ms apart),
/// whichever is later. In a callback that is at the earliest when it was entered. Takes a fifth of the time that
/// [`now_ns`] takes, for it does not ask the hardware.
#[must_use]
#[inline(never)]
pub fn recent_ns() -> u64 {
    read(libc::CLOCK_MONOTONIC_COARSE).max(LAST.get())
}

/// The moment so many nanoseconds from now, on the same clock. Where a tick is little beside them, up to a tick later, and found
/// as fast as [`recent_ns`].
#[must_use]
pub fn in_ns(time_ns: u64) -> u64 {
    let now = if is_long(time_ns) { recent_ns() + TICK_NS } else { now_ns() };
    now.saturating_add(time_ns)
}

/// True of times beside which a tick of the kernel is little.
#[must_use]
pub const fn is_long(time_ns: u64) -> bool {
    time_ns >= 10 * TICK_NS
}

fn read(clock: libc::clockid_t) -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid place for the result; these clocks exist on every Linux.
    unsafe { libc::clock_gettime(clock, &raw mut time) };
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

/// Wall time now, for display. Async-signal-safe.
#[must_use]
pub fn wall() -> libc::timespec {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: as in `now_ns`.
    unsafe { libc::clock_gettime(libc::CLOCK_REALTIME, &raw mut time) };
    time
}

/// Seconds and nanoseconds, for system calls.
#[must_use]
pub fn timespec(nanos: u64) -> libc::timespec {
    libc::timespec { tv_sec: (nanos / 1_000_000_000) as libc::time_t, tv_nsec: (nanos % 1_000_000_000) as libc::c_long }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_recent_is_neither_in_the_future_nor_before_the_last_reading() {
        for _ in 0..100_000 {
            let before = now_ns();
            let recent = recent_ns();
            assert!(before <= recent && recent <= now_ns());
        }
        std::thread::sleep(std::time::Duration::from_millis(30));
        let recent = recent_ns();
        assert!(now_ns() - recent <= 20_000_000, "at most a tick ago, as far as this thread was let run");
    }
}
