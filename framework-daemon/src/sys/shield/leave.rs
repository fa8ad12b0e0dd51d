//! The end of the process: a callback that calls it ends its fiber, a plugin's thread ends alone.
//!
//! glibc's own `abort` holds a lock while it raises SIGABRT. A fiber that is ended inside it leaves that lock to its thread,
//! and the next abort of another component, on another thread, would wait for ever.
//!
//! Rust's standard library believes that a process is left once: a second `std::process::exit` of a plugin aborts on the
//! thread of the first, and pauses for ever on any other. Both are told apart and are an exit again.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};

use super::{Caller, Real, Reals, caller, missing};
use crate::sys::{arch, foreign, seat, trap};

type Leave = extern "C" fn(i32) -> !;

// SAFETY: each takes a code and does not return.
static EXIT: Real<Leave> = unsafe { Real::new(c"exit") };
// SAFETY: as above.
static EXIT_NOW: Real<Leave> = unsafe { Real::new(c"_exit") };
// SAFETY: as above.
static EXIT_NOW_C99: Real<Leave> = unsafe { Real::new(c"_Exit") };
// SAFETY: as above.
static QUICK_EXIT: Real<Leave> = unsafe { Real::new(c"quick_exit") };

// SAFETY: takes nothing, returns a status.
static PAUSE: Real<extern "C" fn() -> i32> = unsafe { Real::new(c"pause") };

pub(super) static REALS: Reals = &[&EXIT, &EXIT_NOW, &EXIT_NOW_C99, &QUICK_EXIT, &PAUSE];

/// Slots that left before, one bit for each as far as 64 reach.
static LEFT: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static LEAVES_AGAIN: Cell<bool> = const { Cell::new(false) };
}

fn own_bit() -> u64 {
    1 << (seat::owner().slot.as_ptr().addr() / size_of::<usize>() % 64)
}

/// What the standard library says before it aborts in a second `exit` of a thread.
const SECOND_EXIT: &str = "std::process::exit called re-entrantly";

/// A panic of plugin code: one that forbids a second `exit` makes the abort that follows an exit.
pub fn note_panic(message: &str) {
    LEAVES_AGAIN.set(message == SECOND_EXIT);
}

/// On a fiber or a plugin's thread a fault (`crash.abort`) without glibc's lock. Elsewhere the end of the process.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn abort() -> ! {
    if LEAVES_AGAIN.replace(false) {
        leave(&EXIT, 1);
    }
    fault();
    // Our handler says the last words.
    trap::raise_abort();
    real(&EXIT_NOW, 134)
}

/// `exit` of a component is a fault of it (`crash.exit`), not the end of the daemon.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn exit(code: i32) -> ! {
    leave(&EXIT, code)
}

/// As [`exit`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn _exit(code: i32) -> ! {
    leave(&EXIT_NOW, code)
}

/// As [`exit`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn _Exit(code: i32) -> ! {
    leave(&EXIT_NOW_C99, code)
}

/// As [`exit`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn quick_exit(code: i32) -> ! {
    leave(&QUICK_EXIT, code)
}

/// As the C library's; where this slot left before, it is the standard library that holds a second exit up.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn pause() -> i32 {
    if LEFT.load(Ordering::Relaxed) & own_bit() != 0 {
        refuse();
    }
    PAUSE.get().map_or_else(missing, |pause| pause())
}

fn leave(function: &Real<Leave>, code: i32) -> ! {
    refuse();
    real(function, code)
}

/// Plugin code leaves: its fiber or its thread ends. Returns where neither is there.
pub(super) fn refuse() {
    let caller = caller();
    if !matches!(caller, Caller::Daemon | Caller::Loader) {
        LEFT.fetch_or(own_bit(), Ordering::Relaxed);
    }
    match caller {
        Caller::Daemon | Caller::Loader => {}
        Caller::Fiber | Caller::Handler => trap::raise_exit(),
        Caller::Thread => foreign::leave(true),
    }
}

/// What plugin code did would end the process: a fault of the caller. Returns where neither fiber nor thread
/// is there to end.
pub(super) fn fault() {
    match caller() {
        Caller::Daemon | Caller::Loader => {}
        Caller::Fiber | Caller::Handler => trap::raise_abort(),
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
