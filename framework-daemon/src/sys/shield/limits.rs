//! What a plugin may not take from the whole process: how much it may use, and which system calls it may make. Refused, as
//! the kernel refuses who lacks the right.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use std::ffi::{c_int, c_ulong};

use libc::rlimit;

use super::{Caller, Real, Reals, caller, missing};

type SetLimit = unsafe extern "C" fn(c_int, *const rlimit) -> c_int;
type ProcessLimit = unsafe extern "C" fn(c_int, c_int, *const rlimit, *mut rlimit) -> c_int;
type Control = unsafe extern "C" fn(c_int, c_ulong, c_ulong, c_ulong, c_ulong) -> c_int;

// SAFETY: resource and limit, returns a status.
static SETRLIMIT: Real<SetLimit> = unsafe { Real::new(c"setrlimit") };
// SAFETY: process, resource, new and old limit, returns a status.
static PRLIMIT: Real<ProcessLimit> = unsafe { Real::new(c"prlimit") };
// SAFETY: an option and up to four words, passed as words whether they are there or not; returns a status.
static PRCTL: Real<Control> = unsafe { Real::new(c"prctl") };

pub(super) static REALS: Reals = &[&SETRLIMIT, &PRLIMIT, &PRCTL];

/// True for plugin code.
fn is_refused() -> bool {
    if caller() == Caller::Daemon {
        return false;
    }
    // SAFETY: the address of this thread's `errno`.
    unsafe { *libc::__errno_location() = libc::EPERM };
    true
}

/// True where `limit` is less than what the process may use now.
unsafe fn lowers(resource: c_int, limit: *const rlimit) -> bool {
    let mut present = rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: the caller's limit is null or valid, as for the C library's function; the call fills the present one.
    unsafe {
        limit.as_ref().is_some_and(|limit| {
            libc::getrlimit(resource as _, &raw mut present);
            limit.rlim_cur < present.rlim_cur
        })
    }
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn setrlimit(resource: c_int, limit: *const rlimit) -> c_int {
    // SAFETY: passed on.
    if unsafe { lowers(resource, limit) } && is_refused() {
        return -1;
    }
    // SAFETY: passed on.
    SETRLIMIT.get().map_or_else(missing, |real| unsafe { real(resource, limit) })
}

/// As [`setrlimit`].
///
/// # Safety
/// As the C library's.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn setrlimit64(resource: c_int, limit: *const rlimit) -> c_int {
    // SAFETY: the same function where words have 64 bits.
    unsafe { setrlimit(resource, limit) }
}

/// As the C library's; who only asks is answered.
///
/// # Safety
/// As the C library's.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn prlimit(process: c_int, resource: c_int, new: *const rlimit, old: *mut rlimit) -> c_int {
    // SAFETY: passed on.
    if super::is_self(process) && unsafe { lowers(resource, new) } && is_refused() {
        return -1;
    }
    // SAFETY: passed on.
    PRLIMIT.get().map_or_else(missing, |real| unsafe { real(process, resource, new, old) })
}

/// As [`prlimit`].
///
/// # Safety
/// As the C library's.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn prlimit64(process: c_int, resource: c_int, new: *const rlimit, old: *mut rlimit) -> c_int {
    // SAFETY: the same function where words have 64 bits.
    unsafe { prlimit(process, resource, new, old) }
}

/// As the C library's, but for filters of system calls, and for signals at the end of another process.
///
/// # Safety
/// As the C library's.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn prctl(option: c_int, a: c_ulong, b: c_ulong, c: c_ulong, d: c_ulong) -> c_int {
    if matches!(option, libc::PR_SET_SECCOMP | libc::PR_SET_PDEATHSIG) && is_refused() {
        return -1;
    }
    // SAFETY: passed on.
    PRCTL.get().map_or_else(missing, |real| unsafe { real(option, a, b, c, d) })
}
