//! Signals that are sent: one that would end or stop this process is a fault of the plugin that sends it.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use super::leave::fault;
use super::{Real, Reals, is_ours, missing};
use crate::sys::trap;

// SAFETY: process and signal, returns a status.
static KILL: Real<extern "C" fn(i32, i32) -> i32> = unsafe { Real::new(c"kill") };
// SAFETY: group and signal, returns a status.
static KILLPG: Real<extern "C" fn(i32, i32) -> i32> = unsafe { Real::new(c"killpg") };
// SAFETY: group of threads, thread, signal, returns a status.
static TGKILL: Real<extern "C" fn(i32, i32, i32) -> i32> = unsafe { Real::new(c"tgkill") };
// SAFETY: signal, returns a status.
static RAISE: Real<extern "C" fn(i32) -> i32> = unsafe { Real::new(c"raise") };
// SAFETY: thread and signal, returns an error number.
static PTHREAD_KILL: Real<extern "C" fn(libc::pthread_t, i32) -> i32> = unsafe { Real::new(c"pthread_kill") };
// SAFETY: process, signal and value, returns a status.
static SIGQUEUE: Real<extern "C" fn(i32, i32, libc::sigval) -> i32> = unsafe { Real::new(c"sigqueue") };

pub(super) static REALS: Reals = &[&KILL, &KILLPG, &TGKILL, &RAISE, &PTHREAD_KILL, &SIGQUEUE];

/// Signals that cannot be caught, or that stop the process or ask it to leave.
const FATAL: [i32; 6] = [libc::SIGKILL, libc::SIGSTOP, libc::SIGTSTP, libc::SIGTTIN, libc::SIGTTOU, libc::SIGQUIT];

/// True where that signal, sent to this process, ends or stops it, or is the daemon's own language.
pub(in crate::sys) fn is_fatal(signal: i32) -> bool {
    is_ours(signal) || FATAL.contains(&signal)
}

/// True where `kill` with that number reaches this process.
pub(in crate::sys) fn is_self(process: i32) -> bool {
    // SAFETY: neither takes memory.
    let (own, group) = unsafe { (libc::getpid(), libc::getpgrp()) };
    process == own || process == 0 || process == -1 || process == -group
}

fn refuse(signal: i32) {
    if is_fatal(signal) {
        fault();
    }
}

/// A signal to this thread: what an instruction could cause is contained as that.
fn refuse_here(signal: i32) {
    if signal == libc::SIGABRT || !trap::SIGNALS.contains(&signal) {
        refuse(signal);
    }
}

/// As the C library's; a fatal signal to this process is a fault of the caller.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn kill(process: i32, signal: i32) -> i32 {
    if is_self(process) {
        refuse(signal);
    }
    KILL.get().map_or_else(missing, |kill| kill(process, signal))
}

/// As [`kill`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn killpg(group: i32, signal: i32) -> i32 {
    if group == 0 || is_self(group.wrapping_neg()) {
        refuse(signal);
    }
    KILLPG.get().map_or_else(missing, |kill| kill(group, signal))
}

/// As [`kill`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn tgkill(process: i32, thread: i32, signal: i32) -> i32 {
    if is_self(process) {
        // SAFETY: takes no memory.
        if thread == unsafe { libc::gettid() } {
            refuse_here(signal);
        } else {
            refuse(signal);
        }
    }
    TGKILL.get().map_or_else(missing, |kill| kill(process, thread, signal))
}

/// As [`kill`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn raise(signal: i32) -> i32 {
    refuse_here(signal);
    RAISE.get().map_or_else(missing, |raise| raise(signal))
}

/// As [`kill`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn pthread_kill(thread: libc::pthread_t, signal: i32) -> i32 {
    // SAFETY: takes no memory.
    if thread == unsafe { libc::pthread_self() } {
        refuse_here(signal);
    } else {
        refuse(signal);
    }
    PTHREAD_KILL.get().map_or(libc::ENOSYS, |kill| kill(thread, signal))
}

/// As [`kill`].
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn sigqueue(process: i32, signal: i32, value: libc::sigval) -> i32 {
    if is_self(process) {
        refuse(signal);
    }
    SIGQUEUE.get().map_or_else(missing, |queue| queue(process, signal, value))
}
