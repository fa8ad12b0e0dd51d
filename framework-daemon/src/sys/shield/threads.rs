//! Threads: each gets a signal stack that is large enough; the standard library's are hardly larger than the kernel's own
//! frame. One that a plugin starts gets open signals and the name of the slot that started it as well.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use libc::{c_void, pthread_attr_t, pthread_t};

use super::leave::fault;
use super::{Caller, Real, Reals, caller};
use crate::sys::{foreign, trap};

type Start = extern "C-unwind" fn(*mut c_void) -> *mut c_void;
type Create = unsafe extern "C" fn(*mut pthread_t, *const pthread_attr_t, Start, *mut c_void) -> i32;

// SAFETY: thread, attributes, function and its argument, returns an error number.
static CREATE: Real<Create> = unsafe { Real::new(c"pthread_create") };
// SAFETY: a value; does not return, but may unwind.
static EXIT: Real<unsafe extern "C-unwind" fn(*mut c_void) -> !> = unsafe { Real::new(c"pthread_exit") };
// SAFETY: a thread, returns an error number.
static CANCEL: Real<unsafe extern "C" fn(pthread_t) -> i32> = unsafe { Real::new(c"pthread_cancel") };

pub(super) static REALS: Reals = &[&CREATE, &EXIT, &CANCEL];

/// As the C library's; the thread starts in [`foreign`].
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn pthread_create(
    thread: *mut pthread_t,
    attributes: *const pthread_attr_t,
    start: Start,
    argument: *mut c_void,
) -> i32 {
    let Some(create) = CREATE.get() else { return libc::ENOSYS };
    let begin = if caller() == Caller::Daemon { foreign::begin_own } else { foreign::begin };
    let birth = foreign::Birth::new(start, argument);
    // SAFETY: the caller's thread and attributes are valid, as for the C library's function; the argument is what
    // both beginnings expect, and is its own from now on where the thread was made.
    unsafe {
        let result = create(thread, attributes, begin, birth.cast());
        if result != 0 {
            foreign::Birth::forget(birth);
        }
        result
    }
}

/// As the C library's; on a fiber a fault (`crash.exit`): the thread is the executor's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C-unwind" fn pthread_exit(value: *mut c_void) -> ! {
    if matches!(caller(), Caller::Fiber | Caller::Handler) {
        trap::raise_exit();
    }
    match EXIT.get() {
        // SAFETY: passed on.
        Some(exit) => unsafe { exit(value) },
        None => crate::sys::arch::exit_thread(),
    }
}

/// As the C library's; a callback that cancels its own thread is at fault: the thread is the executor's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn pthread_cancel(thread: pthread_t) -> i32 {
    // SAFETY: takes no memory.
    if caller() == Caller::Fiber && thread == unsafe { libc::pthread_self() } {
        fault();
    }
    // SAFETY: passed on.
    CANCEL.get().map_or(libc::ENOSYS, |cancel| unsafe { cancel(thread) })
}
