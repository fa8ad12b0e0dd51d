//! The end of the process: a callback that calls it ends its fiber, a plugin's thread ends alone.
//!
//! glibc's own `abort` holds a lock while it raises SIGABRT. A fiber that is ended inside it leaves that lock to its thread,
//! and the next abort of another component, on another thread, would wait for ever.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use super::{Caller, Real, Reals, caller};
use crate::sys::{arch, foreign, trap};

type Leave = extern "C" fn(i32) -> !;

// SAFETY: each takes a code and does not return.
static EXIT: Real<Leave> = unsafe { Real::new(c"exit") };
// SAFETY: as above.
static EXIT_NOW: Real<Leave> = unsafe { Real::new(c"_exit") };
// SAFETY: as above.
static EXIT_NOW_C99: Real<Leave> = unsafe { Real::new(c"_Exit") };
// SAFETY: as above.
static QUICK_EXIT: Real<Leave> = unsafe { Real::new(c"quick_exit") };

pub(super) static REALS: Reals = &[&EXIT, &EXIT_NOW, &EXIT_NOW_C99, &QUICK_EXIT];

/// On a fiber or a plugin's thread a fault (`crash.abort`) without glibc's lock. Elsewhere the end of the process.
#[unsafe(no_mangle)]
pub extern "C" fn abort() -> ! {
    fault();
    // SAFETY: the default action of a signal that is ours to set.
    unsafe { libc::signal(libc::SIGABRT, libc::SIG_DFL) };
    trap::raise_abort();
    real(&EXIT_NOW, 134)
}

/// `exit` of a component is a fault of it (`crash.exit`), not the end of the daemon.
#[unsafe(no_mangle)]
pub extern "C" fn exit(code: i32) -> ! {
    leave(&EXIT, code)
}

/// As [`exit`].
#[unsafe(no_mangle)]
pub extern "C" fn _exit(code: i32) -> ! {
    leave(&EXIT_NOW, code)
}

/// As [`exit`].
#[unsafe(no_mangle)]
pub extern "C" fn _Exit(code: i32) -> ! {
    leave(&EXIT_NOW_C99, code)
}

/// As [`exit`].
#[unsafe(no_mangle)]
pub extern "C" fn quick_exit(code: i32) -> ! {
    leave(&QUICK_EXIT, code)
}

fn leave(function: &Real<Leave>, code: i32) -> ! {
    match caller() {
        Caller::Daemon => {}
        Caller::Fiber => trap::raise_exit(),
        Caller::Thread => foreign::leave(true),
    }
    real(function, code)
}

/// What plugin code did would end the process: a fault of the caller. Returns to the daemon only.
pub(super) fn fault() {
    match caller() {
        Caller::Daemon => {}
        Caller::Fiber => trap::raise_abort(),
        Caller::Thread => foreign::leave(false),
    }
}

fn real(function: &Real<Leave>, code: i32) -> ! {
    if let Some(function) = function.get() {
        function(code);
    }
    loop {
        // SAFETY: takes no memory, and does not return.
        unsafe { arch::system_call(libc::SYS_exit_group, [code as usize, 0, 0, 0, 0, 0]) };
    }
}
