//! Handlers of plugins for signals that are not ours: entered through one of ours, because the kernel calls them on whatever
//! thread it likes. One that fails ends alone: the code that it interrupted, whoever's it is, goes on as if it had returned.
#![allow(unsafe_code, reason = "address of unsafe: signal handlers and register contexts")]

use std::cell::Cell;
use std::sync::atomic::{AtomicI32, AtomicPtr, AtomicUsize, Ordering};

use libc::{c_void, sigaction as Action, sighandler_t as Handler, siginfo_t, ucontext_t};

use super::signals::SIGNAL_MAX;
use crate::sys::arch;
use crate::sys::foreign;
use crate::sys::seat::{self, Owner};
use crate::sys::trap::Trap;

/// What a plugin set for a signal.
struct Entry {
    handler: AtomicUsize,
    flags: AtomicI32,
    owner: AtomicPtr<Owner>,
}

static ENTRIES: [Entry; SIGNAL_MAX + 1] = [const {
    Entry {
        handler: AtomicUsize::new(libc::SIG_DFL),
        flags: AtomicI32::new(0),
        owner: AtomicPtr::new(std::ptr::null_mut()),
    }
}; SIGNAL_MAX + 1];

impl Entry {
    fn of(signal: i32) -> &'static Self {
        &ENTRIES[usize::try_from(signal).unwrap_or(0).min(SIGNAL_MAX)]
    }

    fn owner(&self) -> Owner {
        // SAFETY: null, or leaked by `set`.
        unsafe { self.owner.load(Ordering::Acquire).as_ref() }.copied().unwrap_or(Owner::NONE)
    }

    fn set(&self, action: &Action) {
        let owner = seat::owner();
        if self.owner() != owner {
            // Once for each instance that sets a handler: whoever reads it holds no lock.
            self.owner.store(Box::leak(Box::new(owner)), Ordering::Release);
        }
        self.flags.store(action.sa_flags, Ordering::Release);
        self.handler.store(action.sa_sigaction, Ordering::Release);
    }
}

/// A handler of a plugin that runs: on the stack of what it interrupted.
struct Frame {
    interrupted: *const ucontext_t,
    owner: Owner,
    before: seat::Interrupted,
    outer: *const Self,
}

thread_local! {
    // `const` and without destructor: the trap handler may read it at any moment.
    static FRAME: Cell<*const Frame> = const { Cell::new(std::ptr::null()) };
}

/// True while a plugin's handler runs on this thread.
pub(in crate::sys) fn is_here() -> bool {
    !FRAME.get().is_null()
}

/// A callback begins or ends: a handler that left by a jump has left.
#[inline]
pub(in crate::sys) fn forget() {
    FRAME.set(std::ptr::null());
}

/// The action to be set in the place of a plugin's.
pub(super) fn relayed(signal: i32, action: &Action) -> Action {
    let mut relayed = *action;
    if action.sa_sigaction > libc::SIG_IGN && action.sa_sigaction != libc::SIG_ERR {
        Entry::of(signal).set(action);
        relayed.sa_sigaction = relay_address();
        // On the stack of what it interrupts: the signal stack is the trap handler's.
        relayed.sa_flags = (action.sa_flags | libc::SA_SIGINFO) & !(libc::SA_ONSTACK | libc::SA_RESETHAND);
    }
    relayed
}

/// The action that a plugin set, where the present one stands in its place.
pub(super) fn original(signal: i32, present: &Action) -> Action {
    let mut original = *present;
    if present.sa_sigaction == relay_address() {
        original.sa_sigaction = Entry::of(signal).handler.load(Ordering::Acquire);
        original.sa_flags = Entry::of(signal).flags.load(Ordering::Acquire);
    }
    original
}

fn relay_address() -> Handler {
    relay as extern "C" fn(i32, *mut siginfo_t, *mut c_void) as Handler
}

extern "C" fn relay(signal: i32, info: *mut siginfo_t, context: *mut c_void) {
    let entry = Entry::of(signal);
    let handler = entry.handler.load(Ordering::Acquire);
    let owner = entry.owner();
    let frame = Frame { interrupted: context.cast(), owner, before: seat::interrupt(owner), outer: FRAME.get() };
    FRAME.set(&raw const frame);
    // SAFETY: a function of the signature that the flags tell, as its plugin promised; a plugin is never closed.
    unsafe {
        if entry.flags.load(Ordering::Acquire) & libc::SA_SIGINFO == 0 {
            std::mem::transmute::<Handler, extern "C" fn(i32)>(handler)(signal);
        } else {
            type Long = extern "C" fn(i32, *mut siginfo_t, *mut c_void);
            std::mem::transmute::<Handler, Long>(handler)(signal, info, context);
        }
    }
    FRAME.set(frame.outer);
    seat::resume(frame.before);
}

/// A trap while a plugin's handler runs on this thread: the handler is over, and what it interrupted goes on. False: none
/// runs, or it left by a jump.
pub(in crate::sys) fn struck(trap: Trap, context: &mut ucontext_t) -> bool {
    let (frame, sp) = (FRAME.get(), trap.evidence.sp as usize);
    // Frames below the stack pointer are over.
    if frame.is_null() || frame.addr() < sp {
        return false;
    }
    // SAFETY: `relay` waits in that frame for the handler that trapped.
    let frame = unsafe { &*frame };
    FRAME.set(frame.outer);
    seat::resume(frame.before);
    foreign::failed(frame.owner, trap);
    // SAFETY: the kernel keeps what was interrupted until `relay` returns, which it does not any more.
    arch::resume(context, unsafe { &*frame.interrupted });
    true
}
