//! The monotonic clock, in nanoseconds. Wall time is for display only.
#![allow(unsafe_code, reason = "address of unsafe: the clocks' system call")]

/// `CLOCK_MONOTONIC` now. Async-signal-safe.
#[must_use]
pub fn now_ns() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid place for the result; the clock exists on every Linux.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &raw mut time) };
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
