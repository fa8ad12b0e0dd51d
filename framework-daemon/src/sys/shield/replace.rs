//! The process becomes another program, a copy in the background, or a message and an exit: its end, as far as the robot is
//! concerned, and so a fault of the component (`crash.exit`). What a component forked may become what it likes.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use std::ffi::{c_char, c_int};

use super::leave::{exit, refuse};
use super::{Real, Reals, missing};

type Texts = *const *const c_char;

// SAFETY: path and arguments, returns a status.
static EXECV: Real<unsafe extern "C" fn(*const c_char, Texts) -> c_int> = unsafe { Real::new(c"execv") };
// SAFETY: as above.
static EXECVP: Real<unsafe extern "C" fn(*const c_char, Texts) -> c_int> = unsafe { Real::new(c"execvp") };
// SAFETY: path, arguments and environment, returns a status.
static EXECVE: Real<unsafe extern "C" fn(*const c_char, Texts, Texts) -> c_int> = unsafe { Real::new(c"execve") };
// SAFETY: as above.
static EXECVPE: Real<unsafe extern "C" fn(*const c_char, Texts, Texts) -> c_int> = unsafe { Real::new(c"execvpe") };
// SAFETY: descriptor, arguments and environment, returns a status.
static FEXECVE: Real<unsafe extern "C" fn(c_int, Texts, Texts) -> c_int> = unsafe { Real::new(c"fexecve") };
// SAFETY: two flags, returns a status.
static DAEMON: Real<extern "C" fn(c_int, c_int) -> c_int> = unsafe { Real::new(c"daemon") };

pub(super) static REALS: Reals = &[&EXECV, &EXECVP, &EXECVE, &EXECVPE, &FEXECVE, &DAEMON];

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn execv(path: *const c_char, arguments: Texts) -> c_int {
    refuse();
    // SAFETY: passed on.
    EXECV.get().map_or_else(missing, |real| unsafe { real(path, arguments) })
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn execvp(path: *const c_char, arguments: Texts) -> c_int {
    refuse();
    // SAFETY: passed on.
    EXECVP.get().map_or_else(missing, |real| unsafe { real(path, arguments) })
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn execve(path: *const c_char, arguments: Texts, environment: Texts) -> c_int {
    refuse();
    // SAFETY: passed on.
    EXECVE.get().map_or_else(missing, |real| unsafe { real(path, arguments, environment) })
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn execvpe(path: *const c_char, arguments: Texts, environment: Texts) -> c_int {
    refuse();
    // SAFETY: passed on.
    EXECVPE.get().map_or_else(missing, |real| unsafe { real(path, arguments, environment) })
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn fexecve(descriptor: c_int, arguments: Texts, environment: Texts) -> c_int {
    refuse();
    // SAFETY: passed on.
    FEXECVE.get().map_or_else(missing, |real| unsafe { real(descriptor, arguments, environment) })
}

/// As the C library's; its parent's end would be ours.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn daemon(keep_directory: c_int, keep_output: c_int) -> c_int {
    refuse();
    DAEMON.get().map_or_else(missing, |real| real(keep_directory, keep_output))
}

/// A message and an exit. The message is lost: its arguments cannot be passed on from here, and the daemon never calls it.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn err(code: c_int) -> ! {
    exit(code)
}

/// As [`err`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn errx(code: c_int) -> ! {
    exit(code)
}

/// As [`err`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn verr(code: c_int) -> ! {
    exit(code)
}

/// As [`err`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn verrx(code: c_int) -> ! {
    exit(code)
}

/// As [`err`] where there is a code; else only the message is lost.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn error(code: c_int) {
    if code != 0 {
        exit(code);
    }
}
