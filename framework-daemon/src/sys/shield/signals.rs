//! Handlers, masks and signal stacks: a plugin's calls succeed, and change nothing that containment rests on.
//!
//! What a plugin sets for a signal of ours is remembered, because libraries ask for the old action to restore it.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering};

use libc::{sigaction as Action, sighandler_t as Handler, sigset_t as Set, stack_t as Stack};

use super::{Caller, Real, Reals, caller, handlers, missing};
use crate::sys::trap;

type SetAction = unsafe extern "C" fn(i32, *const Action, *mut Action) -> i32;
type SetHandler = unsafe extern "C" fn(i32, Handler) -> Handler;
type SetMask = unsafe extern "C" fn(i32, *const Set, *mut Set) -> i32;
type OneSignal = unsafe extern "C" fn(i32) -> i32;

// SAFETY: signal, new and old action, returns a status.
static SIGACTION: Real<SetAction> = unsafe { Real::new(c"sigaction") };
// SAFETY: signal and handler, returns the old handler.
static SIGNAL: Real<SetHandler> = unsafe { Real::new(c"signal") };
// SAFETY: as above.
static SIGSET: Real<SetHandler> = unsafe { Real::new(c"sigset") };
// SAFETY: signal, returns a status.
static SIGIGNORE: Real<OneSignal> = unsafe { Real::new(c"sigignore") };
// SAFETY: as above.
static SIGHOLD: Real<OneSignal> = unsafe { Real::new(c"sighold") };
// SAFETY: how, new and old mask, returns a status.
static SIGPROCMASK: Real<SetMask> = unsafe { Real::new(c"sigprocmask") };
// SAFETY: how, new and old mask, returns an error number.
static PTHREAD_SIGMASK: Real<SetMask> = unsafe { Real::new(c"pthread_sigmask") };
// SAFETY: new and old stack, returns a status.
static SIGALTSTACK: Real<unsafe extern "C" fn(*const Stack, *mut Stack) -> i32> = unsafe { Real::new(c"sigaltstack") };

pub(super) static REALS: Reals =
    &[&SIGACTION, &SIGNAL, &SIGSET, &SIGIGNORE, &SIGHOLD, &SIGPROCMASK, &PTHREAD_SIGMASK, &SIGALTSTACK];

/// What supervisors and terminals tell the daemon, and what a pipe tells it that nobody reads.
const TOLD: [i32; 5] = [libc::SIGTERM, libc::SIGINT, libc::SIGHUP, libc::SIGPIPE, libc::SIGUSR1];

/// What would end the process by default and means nothing to the daemon.
const QUIET: [i32; 8] = [
    libc::SIGALRM,
    libc::SIGVTALRM,
    libc::SIGPROF,
    libc::SIGUSR2,
    libc::SIGIO,
    libc::SIGPWR,
    libc::SIGSTKFLT,
    libc::SIGXFSZ,
];

/// Highest signal number of Linux.
pub(super) const SIGNAL_MAX: usize = 64;

/// `SIG_HOLD`: not an action but a mask.
const HOLD: Handler = 2;

/// True for signals whose handler and mask are the daemon's.
pub(in crate::sys) fn is_ours(signal: i32) -> bool {
    trap::SIGNALS.contains(&signal) || TOLD.contains(&signal) || signal == trap::watchdog_signal()
}

fn is_quiet(signal: i32) -> bool {
    QUIET.contains(&signal) || (libc::SIGRTMIN()..=libc::SIGRTMAX()).contains(&signal)
}

/// What a plugin set for a signal of ours.
struct Kept {
    handler: AtomicUsize,
    flags: AtomicI32,
    mask: AtomicU64,
}

static KEPT: [Kept; SIGNAL_MAX + 1] =
    [const { Kept { handler: AtomicUsize::new(libc::SIG_DFL), flags: AtomicI32::new(0), mask: AtomicU64::new(0) } };
        SIGNAL_MAX + 1];

/// The words of a set; the kernel's is the first.
const WORDS: usize = size_of::<Set>() / size_of::<u64>();

fn words(set: &Set) -> [u64; WORDS] {
    // SAFETY: a set is that many words without padding, each of any value.
    unsafe { std::mem::transmute_copy(set) }
}

impl Kept {
    fn of(signal: i32) -> &'static Self {
        &KEPT[usize::try_from(signal).unwrap_or(0).min(SIGNAL_MAX)]
    }

    fn action(&self) -> Action {
        // SAFETY: an all-zero action is valid, and so is a set whose first word is any.
        let mut action: Action = unsafe { std::mem::zeroed() };
        let mut mask = [0; WORDS];
        mask[0] = self.mask.load(Ordering::Relaxed);
        // SAFETY: as in `words`.
        action.sa_mask = unsafe { std::mem::transmute_copy(&mask) };
        action.sa_sigaction = self.handler.load(Ordering::Relaxed);
        action.sa_flags = self.flags.load(Ordering::Relaxed);
        action
    }

    fn keep(&self, action: &Action) {
        self.handler.store(action.sa_sigaction, Ordering::Relaxed);
        self.flags.store(action.sa_flags, Ordering::Relaxed);
        self.mask.store(words(&action.sa_mask)[0], Ordering::Relaxed);
    }
}

/// A copy without the signals that are ours.
pub(super) fn without_ours(set: &Set) -> Set {
    let mut set = *set;
    for signal in (1..=SIGNAL_MAX as i32).filter(|signal| is_ours(*signal)) {
        // SAFETY: a live set and a valid number.
        unsafe { libc::sigdelset(&raw mut set, signal) };
    }
    set
}

/// Lets this thread be told of our signals, whatever its creator masked.
pub(in crate::sys) fn unblock_ours() {
    // SAFETY: an all-zero set is valid; the calls read and write this one only.
    unsafe {
        let mut set: Set = std::mem::zeroed();
        libc::sigemptyset(&raw mut set);
        for signal in (1..=SIGNAL_MAX as i32).filter(|signal| is_ours(*signal)) {
            libc::sigaddset(&raw mut set, signal);
        }
        libc::pthread_sigmask(libc::SIG_UNBLOCK, &raw const set, std::ptr::null_mut());
    }
}

/// Does nothing. Not "ignored", which child processes would inherit.
extern "C" fn nothing(_: i32) {}

fn nothing_address() -> Handler {
    nothing as extern "C" fn(i32) as Handler
}

/// Signals that would end the process by default and that nobody listens to do nothing from now on.
pub(super) fn quiet() {
    for signal in (1..=SIGNAL_MAX as i32).filter(|signal| is_quiet(*signal) && !is_ours(*signal)) {
        // SAFETY: an all-zero action is valid, and the handler does nothing; the old one is only looked at.
        unsafe {
            let mut old: Action = std::mem::zeroed();
            libc::sigaction(signal, std::ptr::null(), &raw mut old);
            if old.sa_sigaction == libc::SIG_DFL {
                let mut new: Action = std::mem::zeroed();
                new.sa_sigaction = nothing_address();
                new.sa_flags = libc::SA_RESTART;
                libc::sigaction(signal, &raw const new, std::ptr::null_mut());
            }
        }
    }
}

/// The action that a plugin wants for a signal that is not ours, as far as the daemon survives it.
fn tamed(signal: i32, action: &Action) -> Action {
    let mut action = *action;
    action.sa_mask = without_ours(&action.sa_mask);
    let is_nothing = action.sa_sigaction == libc::SIG_DFL && is_quiet(signal);
    if !is_nothing && action.sa_sigaction != nothing_address() {
        return handlers::relayed(signal, &action);
    }
    (action.sa_sigaction, action.sa_flags) = (nothing_address(), libc::SA_RESTART);
    action
}

/// As the C library's; no effect on signals that are ours.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sigaction(signal: i32, new: *const Action, old: *mut Action) -> i32 {
    let Some(real) = SIGACTION.get() else { return missing() };
    // SAFETY: the caller's pointers are null or valid, as for the C library's function.
    unsafe {
        if caller() == Caller::Daemon {
            return real(signal, new, old);
        }
        // Copied first: both may be the same, and a bad pointer must change nothing.
        let wanted = new.as_ref().copied();
        if !is_ours(signal) {
            let mut before = std::mem::zeroed();
            // Its handler is known before the kernel calls it.
            let known = real(signal, std::ptr::null(), &raw mut before);
            let original = handlers::original(signal, &before);
            let tamed = wanted.map(|action| tamed(signal, &action));
            if known == 0
                && let Some(old) = old.as_mut()
            {
                *old = original;
            }
            return tamed.map_or(known, |action| real(signal, &raw const action, std::ptr::null_mut()));
        }
        let kept = Kept::of(signal);
        if let Some(old) = old.as_mut() {
            *old = kept.action();
        }
        wanted.iter().for_each(|action| kept.keep(action));
    }
    0
}

/// `signal` in all its spellings.
unsafe fn set_handler(real: &Real<SetHandler>, signal: i32, handler: Handler) -> Handler {
    let Some(real) = real.get() else {
        missing();
        return libc::SIG_ERR;
    };
    let is_mask = handler == HOLD;
    // SAFETY: as the caller's call; an all-zero action is valid.
    unsafe {
        if caller() == Caller::Daemon || (is_mask && !is_ours(signal)) {
            return real(signal, handler);
        }
        let (mut new, mut old): (Action, Action) = (std::mem::zeroed(), std::mem::zeroed());
        (new.sa_sigaction, new.sa_flags) = (handler, libc::SA_RESTART);
        let new = if is_mask { std::ptr::null() } else { &raw const new };
        if sigaction(signal, new, &raw mut old) == 0 { old.sa_sigaction } else { libc::SIG_ERR }
    }
}

/// As the C library's; no effect on signals that are ours.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn signal(signal: i32, handler: Handler) -> Handler {
    // SAFETY: passed on.
    unsafe { set_handler(&SIGNAL, signal, handler) }
}

/// As [`signal`].
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn bsd_signal(signal: i32, handler: Handler) -> Handler {
    // SAFETY: passed on.
    unsafe { set_handler(&SIGNAL, signal, handler) }
}

/// As [`signal`].
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn ssignal(signal: i32, handler: Handler) -> Handler {
    // SAFETY: passed on.
    unsafe { set_handler(&SIGNAL, signal, handler) }
}

/// As [`signal`]: the handler stays, because what System V leaves behind is the default.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sysv_signal(signal: i32, handler: Handler) -> Handler {
    // SAFETY: passed on.
    unsafe { set_handler(&SIGNAL, signal, handler) }
}

/// As [`sysv_signal`]: its name in programs.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn __sysv_signal(signal: i32, handler: Handler) -> Handler {
    // SAFETY: passed on.
    unsafe { set_handler(&SIGNAL, signal, handler) }
}

/// As [`signal`].
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sigset(signal: i32, handler: Handler) -> Handler {
    // SAFETY: passed on.
    unsafe { set_handler(&SIGSET, signal, handler) }
}

/// As the C library's; no effect on signals that are ours.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sigignore(signal: i32) -> i32 {
    if is_ours(signal) && caller() != Caller::Daemon {
        Kept::of(signal).handler.store(libc::SIG_IGN, Ordering::Relaxed);
        return 0;
    }
    // SAFETY: passed on.
    SIGIGNORE.get().map_or_else(missing, |real| unsafe { real(signal) })
}

/// As the C library's; no effect on signals that are ours.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sighold(signal: i32) -> i32 {
    if is_ours(signal) && caller() != Caller::Daemon {
        return 0;
    }
    // SAFETY: passed on.
    SIGHOLD.get().map_or_else(missing, |real| unsafe { real(signal) })
}

/// Calls `real` with the set, or for plugin code with what of it is not ours.
unsafe fn set_mask(real: SetMask, how: i32, new: *const Set, old: *mut Set) -> i32 {
    // SAFETY: the caller's pointers are null or valid, as for the C library's function.
    unsafe {
        let harmless = match new.as_ref() {
            Some(set) if how != libc::SIG_UNBLOCK && caller() != Caller::Daemon => Some(without_ours(set)),
            _ => None,
        };
        real(how, harmless.as_ref().map_or(new, std::ptr::from_ref), old)
    }
}

/// As the C library's; signals that are ours stay open.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sigprocmask(how: i32, new: *const Set, old: *mut Set) -> i32 {
    // SAFETY: passed on.
    SIGPROCMASK.get().map_or_else(missing, |real| unsafe { set_mask(real, how, new, old) })
}

/// As [`sigprocmask`].
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn pthread_sigmask(how: i32, new: *const Set, old: *mut Set) -> i32 {
    // SAFETY: passed on.
    PTHREAD_SIGMASK.get().map_or(libc::ENOSYS, |real| unsafe { set_mask(real, how, new, old) })
}

/// As the C library's; for plugin code it changes nothing: the stack that is there is the handler's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn sigaltstack(new: *const Stack, old: *mut Stack) -> i32 {
    let new = if caller() == Caller::Daemon { new } else { std::ptr::null() };
    // SAFETY: passed on.
    SIGALTSTACK.get().map_or_else(missing, |real| unsafe { real(new, old) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sys::fiber::{Ended, Fiber, NEVER};

    /// Runs as a component's callback does.
    fn as_plugin<T>(closure: impl Fn() -> T) -> T {
        let mut result = None;
        let ended = Fiber::<()>::new(64 << 10).unwrap().run(NEVER, &mut || result = Some(closure()));
        assert_eq!(ended, Ended::Returned);
        result.unwrap()
    }

    fn present(signal: i32) -> Handler {
        // SAFETY: an all-zero action is valid.
        unsafe {
            let mut action: Action = std::mem::zeroed();
            assert_eq!(libc::sigaction(signal, std::ptr::null(), &raw mut action), 0);
            action.sa_sigaction
        }
    }

    #[test]
    fn a_handler_of_a_plugin_is_remembered_and_has_no_effect() {
        super::super::install();
        trap::install();
        let before = present(libc::SIGSEGV);
        let told = as_plugin(|| {
            // SAFETY: handlers that are never called.
            unsafe { [libc::signal(libc::SIGSEGV, 4711), libc::signal(libc::SIGSEGV, libc::SIG_DFL)] }
        });
        assert_eq!((told, present(libc::SIGSEGV)), ([libc::SIG_DFL, 4711], before));
        // SAFETY: an all-zero action is valid: the default.
        let told = as_plugin(|| unsafe {
            let mut action: Action = std::mem::zeroed();
            action.sa_sigaction = 4712;
            action.sa_flags = libc::SA_NODEFER;
            libc::sigaction(libc::SIGBUS, &raw const action, std::ptr::null_mut());
            libc::sigaction(libc::SIGBUS, std::ptr::null(), &raw mut action);
            (action.sa_sigaction, action.sa_flags)
        });
        assert_eq!(told, (4712, libc::SA_NODEFER));
    }

    #[test]
    fn the_default_of_a_signal_that_would_end_the_process_is_nothing() {
        super::super::install();
        // SAFETY: the default of a signal, and that signal.
        let sent = as_plugin(|| unsafe {
            libc::signal(libc::SIGUSR2, libc::SIG_DFL);
            libc::raise(libc::SIGUSR2)
        });
        assert_eq!((sent, present(libc::SIGUSR2)), (0, nothing_address()));
    }

    #[test]
    fn a_mask_of_everything_leaves_ours_open() {
        let blocked = as_plugin(|| {
            // SAFETY: an all-zero set is valid; the calls read and write these only.
            unsafe {
                let (mut all, mut now): (Set, Set) = (std::mem::zeroed(), std::mem::zeroed());
                libc::sigfillset(&raw mut all);
                libc::pthread_sigmask(libc::SIG_SETMASK, &raw const all, &raw mut now);
                libc::sigprocmask(libc::SIG_SETMASK, &raw const now, &raw mut all);
                [libc::SIGSEGV, libc::SIGTERM, trap::watchdog_signal(), libc::SIGUSR2]
                    .map(|signal| libc::sigismember(&raw const all, signal))
            }
        });
        assert_eq!(blocked, [0, 0, 0, 1]);
    }
}
