//! Sees which callback is over its deadline and signals the thread that runs it; the handler there does the rest
//! ([`crate::sys::trap`]).
//!
//! It sleeps until the earliest deadline, or until one could pass that began after it looked: exact, and without a timer
//! for each callback, which would cost each 0.7 us. One thread for all executors, at a real-time priority where that is
//! permitted: a callback that spins at the same priority must not keep it from running.
#![allow(unsafe_code, reason = "address of unsafe: a signal to a thread")]

use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};

use super::pulse::Pulse;
use super::wake::Waker;
use super::{arch, clock, thread, trap};
use crate::model::limits::{PRIORITY_MAX, WATCHDOG_RETRY};
use crate::model::schedule::{Policy, Schedule};
use crate::model::time::nanoseconds;

struct Watchdog {
    pulses: Mutex<Vec<Watched>>,
    waker: Waker,
}

struct Watched {
    pulse: Weak<Pulse>,
    /// The deadline that was signalled last, and when it may be signalled again.
    signalled: Option<(u64, u64)>,
}

static WATCHDOG: OnceLock<Watchdog> = OnceLock::new();

/// Starts the watchdog, once in a process.
///
/// # Errors
/// When the system has no thread left.
pub fn start() -> std::io::Result<()> {
    if WATCHDOG.set(Watchdog { pulses: Mutex::default(), waker: Waker::default() }).is_err() {
        return Ok(());
    }
    // Above the executors' highest; without the permission it runs like any other thread, and the executors say so.
    let schedule = Schedule { policy: Policy::Fifo, priority: PRIORITY_MAX, cpus: Vec::new() };
    thread::spawn_guarded("watchdog", schedule, |_| {}, watch)?;
    Ok(())
}

/// Watches this pulse as long as somebody holds it.
pub fn add(pulse: &Arc<Pulse>) {
    let Some(watchdog) = WATCHDOG.get() else { return };
    let watched = Watched { pulse: Arc::downgrade(pulse), signalled: None };
    watchdog.pulses.lock().unwrap_or_else(PoisonError::into_inner).push(watched);
    watchdog.waker.wake();
}

/// A deadline is nearer than it was: it is looked at again.
pub fn look_again() {
    WATCHDOG.get().into_iter().for_each(|watchdog| watchdog.waker.wake());
}

/// Callbacks of this pulse may be entered with as little time as that from now on.
pub fn expect(pulse: &Pulse, limit_ns: u64) {
    if pulse.shorten(limit_ns)
        && let Some(watchdog) = WATCHDOG.get()
    {
        watchdog.waker.wake();
    }
}

fn watch() {
    let Some(watchdog) = WATCHDOG.get() else { return };
    loop {
        let next = look(&mut watchdog.pulses.lock().unwrap_or_else(PoisonError::into_inner));
        watchdog.waker.wait_until(next);
    }
}

/// Looks at all of them; returns when to look again.
fn look(pulses: &mut Vec<Watched>) -> Option<u64> {
    pulses.retain(|watched| watched.pulse.strong_count() > 0);
    let now = clock::now_ns();
    pulses.iter_mut().filter_map(|watched| watched.look(now)).min()
}

impl Watched {
    fn look(&mut self, now: u64) -> Option<u64> {
        let pulse = self.pulse.upgrade()?;
        // Whatever begins after this look has at least that long.
        let later = now.checked_add(pulse.shortest_ns());
        let Some(deadline) = pulse.deadline_ns().filter(|deadline| *deadline != u64::MAX) else { return later };
        if deadline > now {
            return later.map_or(Some(deadline), |later| Some(deadline.min(later)));
        }
        let again = match self.signalled {
            Some((signalled, again)) if signalled == deadline && again > now => again,
            before => {
                if before.is_none_or(|(signalled, _)| signalled != deadline) {
                    pulse.forget_attempts();
                }
                signal(pulse.thread());
                now + nanoseconds(WATCHDOG_RETRY)
            }
        };
        self.signalled = Some((deadline, again));
        Some(again)
    }
}

fn signal(thread: i32) {
    let arguments = [std::process::id() as usize, thread as usize, trap::watchdog_signal() as usize, 0, 0, 0];
    // SAFETY: no memory is passed; the signal is ours, and its handler looks for itself whether anything is late. A thread
    // that is gone by now makes the call fail.
    unsafe { arch::system_call(libc::SYS_tgkill, arguments) };
}
