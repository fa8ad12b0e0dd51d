//! Calls that wait with a mask of their own: signals that are ours stay open, so that a wait for ever ends at its deadline.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use libc::{c_int, epoll_event, fd_set, nfds_t, pollfd, sigset_t as Set, timespec};

use super::signals::without_ours;
use super::{Caller, Real, Reals, caller, missing};

type Ppoll = unsafe extern "C" fn(*mut pollfd, nfds_t, *const timespec, *const Set) -> c_int;
type Sets = *mut fd_set;
type Pselect = unsafe extern "C" fn(c_int, Sets, Sets, Sets, *const timespec, *const Set) -> c_int;
type EpollPwait = unsafe extern "C" fn(c_int, *mut epoll_event, c_int, c_int, *const Set) -> c_int;

// SAFETY: mask, returns a status.
static SIGSUSPEND: Real<unsafe extern "C" fn(*const Set) -> c_int> = unsafe { Real::new(c"sigsuspend") };
// SAFETY: descriptors, their number, time and mask, returns a number.
static PPOLL: Real<Ppoll> = unsafe { Real::new(c"ppoll") };
// SAFETY: highest descriptor, three sets, time and mask, returns a number.
static PSELECT: Real<Pselect> = unsafe { Real::new(c"pselect") };
// SAFETY: descriptor, events, their number, time and mask, returns a number.
static EPOLL_PWAIT: Real<EpollPwait> = unsafe { Real::new(c"epoll_pwait") };

pub(super) static REALS: Reals = &[&SIGSUSPEND, &PPOLL, &PSELECT, &EPOLL_PWAIT];

/// Calls `wait` with the mask, or for plugin code with what of it is not ours.
unsafe fn with_mask(mask: *const Set, wait: impl FnOnce(*const Set) -> c_int) -> c_int {
    // SAFETY: the caller's mask is null or valid, as for the C library's function.
    let harmless = unsafe { mask.as_ref() }.filter(|_| caller() != Caller::Daemon).map(without_ours);
    wait(harmless.as_ref().map_or(mask, std::ptr::from_ref))
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sigsuspend(mask: *const Set) -> c_int {
    let Some(real) = SIGSUSPEND.get() else { return missing() };
    // SAFETY: passed on.
    unsafe { with_mask(mask, |mask| real(mask)) }
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn ppoll(ends: *mut pollfd, count: nfds_t, time: *const timespec, mask: *const Set) -> c_int {
    let Some(real) = PPOLL.get() else { return missing() };
    // SAFETY: passed on.
    unsafe { with_mask(mask, |mask| real(ends, count, time, mask)) }
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn pselect(
    highest: c_int,
    read: Sets,
    write: Sets,
    except: Sets,
    time: *const timespec,
    mask: *const Set,
) -> c_int {
    let Some(real) = PSELECT.get() else { return missing() };
    // SAFETY: passed on.
    unsafe { with_mask(mask, |mask| real(highest, read, write, except, time, mask)) }
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn epoll_pwait(
    queue: c_int,
    events: *mut epoll_event,
    count: c_int,
    milliseconds: c_int,
    mask: *const Set,
) -> c_int {
    let Some(real) = EPOLL_PWAIT.get() else { return missing() };
    // SAFETY: passed on.
    unsafe { with_mask(mask, |mask| real(queue, events, count, milliseconds, mask)) }
}
