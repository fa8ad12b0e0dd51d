//! The server's end of a push: whether it sends, how often at most, and its cycle. What it sends goes the way of all data.
//!
//! All but what clients look at belongs to the thread of the slot's executor.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use component_sdk::abi::calls::{ServeArgs, ServeKind};
use component_sdk::abi::payload::PortHandle;
use component_sdk::abi::push::{PushDecl, PushEnd};
use component_sdk::port::Sent;
use component_sdk::status::Status;

use super::provider::Openness;
use crate::port::wait::Waiter;
use crate::sys::bell::{Ring, Signal};
use crate::sys::clock;

/// When an output sends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cycle {
    /// It has a cycle of so many nanoseconds, and sends while that runs.
    pub period_ns: Option<u64>,
    /// The cycle starts with the slot.
    pub started: bool,
    /// Least time between two values in nanoseconds.
    pub min_cycle_ns: u64,
}

impl Cycle {
    /// What a class says.
    #[must_use]
    pub fn of(decl: &PushDecl) -> Self {
        Self {
            period_ns: (decl.end == PushEnd::Timed).then_some(decl.period_ns.max(1)),
            started: decl.started,
            min_cycle_ns: decl.min_cycle_ns,
        }
    }
}

/// The server's end of a push.
pub struct Outlet {
    cycle: Cycle,
    pub(super) waiter: Arc<Waiter>,
    running: AtomicBool,
    open: AtomicU8,
    /// When it sent last; 0: never.
    last_ns: AtomicU64,
    /// When its next cycle begins.
    due_ns: AtomicU64,
    /// A cycle has begun, and its handler was not entered yet.
    ticks: AtomicBool,
    /// The handle of the instance in use.
    handle: AtomicUsize,
    signal: OnceLock<Arc<Signal>>,
    early: AtomicU64,
    missed: AtomicU64,
}

impl Outlet {
    /// One that is not open yet.
    #[must_use]
    pub fn new(cycle: Cycle, waiter: Arc<Waiter>) -> Self {
        Self {
            cycle,
            waiter,
            running: AtomicBool::new(false),
            open: AtomicU8::new(Openness::Starting as u8),
            last_ns: AtomicU64::new(0),
            due_ns: AtomicU64::new(0),
            ticks: AtomicBool::new(false),
            handle: AtomicUsize::new(0),
            signal: OnceLock::new(),
            early: AtomicU64::new(0),
            missed: AtomicU64::new(0),
        }
    }

    /// When it sends.
    #[must_use]
    pub const fn cycle(&self) -> Cycle {
        self.cycle
    }

    /// True where it sends whatever it is given.
    #[must_use]
    pub const fn is_plain(&self) -> bool {
        self.cycle.period_ns.is_none() && self.cycle.min_cycle_ns == 0
    }

    /// Says who is rung when a cycle begins; once.
    pub fn listen(&self, signal: Arc<Signal>) {
        let _ = self.signal.set(signal);
    }

    /// From now on the instance with this handle serves.
    pub fn bind(&self, handle: PortHandle) {
        self.handle.store(handle.0.addr(), Ordering::Release);
    }

    /// Values that came too early, and cycles that were left out.
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        (self.early.load(Ordering::Relaxed), self.missed.load(Ordering::Relaxed))
    }

    /// True while it sends: always where it has no cycle.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.cycle.period_ns.is_none() || self.running.load(Ordering::SeqCst)
    }

    fn openness(&self) -> Openness {
        Openness::of(self.open.load(Ordering::SeqCst))
    }

    /// What a client gets that waits for its next value, if that will not come.
    #[must_use]
    pub fn refusal(&self) -> Option<Status> {
        self.openness().refusal()
    }

    /// Its slot is removed or built anew.
    #[must_use]
    pub fn is_replaced(&self) -> bool {
        self.openness() == Openness::Replaced
    }

    /// Whether its slot works; one that was replaced stays so.
    pub(in crate::port) fn set_open(&self, open: Openness) {
        if !self.is_replaced() {
            self.open.store(open as u8, Ordering::SeqCst);
        }
    }

    /// What a value gets that is not sent now, if it is not.
    pub(in crate::port) fn withholds(&self) -> Option<Sent> {
        if !self.is_running() {
            return Some(Sent::NotActivated);
        }
        if self.cycle.min_cycle_ns == 0 {
            return None;
        }
        let (now_ns, last_ns) = (clock::now_ns(), self.last_ns.load(Ordering::Relaxed));
        if last_ns != 0 && now_ns.saturating_sub(last_ns) < self.cycle.min_cycle_ns {
            self.early.fetch_add(1, Ordering::Relaxed);
            return Some(Sent::TooEarly);
        }
        self.last_ns.store(now_ns, Ordering::Relaxed);
        None
    }

    /// Begins the cycle; false: it runs already.
    ///
    /// # Errors
    /// `NotAllowed`: it has none.
    pub(in crate::port) fn start(&self) -> Result<bool, Status> {
        let period_ns = self.cycle.period_ns.ok_or(Status::NotAllowed)?;
        if self.running.swap(true, Ordering::SeqCst) {
            return Ok(false);
        }
        self.due_ns.store(clock::now_ns().saturating_add(period_ns), Ordering::Relaxed);
        self.tick();
        Ok(true)
    }

    /// Ends the cycle; false: it does not run.
    ///
    /// # Errors
    /// `NotAllowed`: it has none.
    pub(in crate::port) fn stop(&self) -> Result<bool, Status> {
        self.cycle.period_ns.ok_or(Status::NotAllowed)?;
        self.ticks.store(false, Ordering::Relaxed);
        Ok(self.running.swap(false, Ordering::SeqCst))
    }

    fn tick(&self) {
        self.ticks.store(true, Ordering::Relaxed);
        if let Some(signal) = self.signal.get() {
            signal.ring(Ring::Serve);
        }
    }

    /// When its next cycle begins; `None`: it does not run.
    #[must_use]
    pub fn due_ns(&self) -> Option<u64> {
        self.running.load(Ordering::Relaxed).then(|| self.due_ns.load(Ordering::Relaxed))
    }

    /// Begins the cycles that are due: one of them, the others are left out, as is one whose predecessor waits for its
    /// handler still.
    pub fn turn(&self, now_ns: u64) {
        let Some(due_ns) = self.due_ns().filter(|due_ns| *due_ns <= now_ns) else { return };
        let period_ns = self.cycle.period_ns.unwrap_or(1);
        let over = (now_ns - due_ns) / period_ns;
        self.due_ns.store(due_ns + (over + 1) * period_ns, Ordering::Relaxed);
        let waits = self.has_ticked();
        self.missed.fetch_add(over + u64::from(waits), Ordering::Relaxed);
        if !waits {
            self.tick();
        }
    }

    /// True when a cycle has begun whose handler was not entered.
    #[must_use]
    pub fn has_ticked(&self) -> bool {
        self.ticks.load(Ordering::Relaxed)
    }

    /// What the handler of a cycle that has begun is entered with.
    #[must_use]
    pub fn next(&self) -> Option<ServeArgs> {
        if !self.has_ticked() || !self.ticks.swap(false, Ordering::Relaxed) {
            return None;
        }
        let port = PortHandle(std::ptr::without_provenance(self.handle.load(Ordering::Acquire)));
        Some(ServeArgs { port, what: ServeKind::Tick, ..ServeArgs::NONE })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outlet(cycle: Cycle) -> Outlet {
        Outlet::new(cycle, Waiter::new())
    }

    fn timed(period_ns: u64) -> Outlet {
        outlet(Cycle { period_ns: Some(period_ns), ..Cycle::default() })
    }

    #[test]
    fn the_first_cycle_begins_at_once_and_the_others_when_they_are_due() {
        let outlet = timed(1_000_000_000_000);
        assert_eq!((outlet.due_ns(), outlet.withholds()), (None, Some(Sent::NotActivated)));
        assert_eq!((outlet.start(), outlet.start()), (Ok(true), Ok(false)));
        assert!(outlet.next().is_some() && outlet.next().is_none());
        let due_ns = outlet.due_ns().unwrap();
        outlet.turn(due_ns - 1);
        assert!(!outlet.has_ticked());
        outlet.turn(due_ns);
        assert!(outlet.has_ticked());
        assert_eq!(outlet.due_ns(), Some(due_ns + 1_000_000_000_000));
        assert_eq!((outlet.stop(), outlet.stop()), (Ok(true), Ok(false)));
        assert_eq!((outlet.due_ns(), outlet.has_ticked()), (None, false));
    }

    #[test]
    fn cycles_that_are_over_are_counted_and_keep_their_grid() {
        let outlet = timed(1_000_000_000_000);
        outlet.start().unwrap();
        let due_ns = outlet.due_ns().unwrap();
        outlet.turn(due_ns + 2_500_000_000_000);
        // Two are over, and the third finds the first one waiting.
        assert_eq!((outlet.counts().1, outlet.due_ns()), (3, Some(due_ns + 3_000_000_000_000)));
        assert!(outlet.next().is_some() && outlet.next().is_none());
    }

    #[test]
    fn what_comes_too_early_is_withheld_and_counted() {
        let outlet = outlet(Cycle { min_cycle_ns: u64::MAX, ..Cycle::default() });
        assert_eq!((outlet.withholds(), outlet.withholds()), (None, Some(Sent::TooEarly)));
        assert_eq!(outlet.counts().0, 1);
        assert!(outlet.start().is_err() && outlet.stop().is_err(), "it has no cycle");
    }

    #[test]
    fn one_that_was_replaced_stays_so() {
        let outlet = timed(1);
        outlet.set_open(Openness::Replaced);
        outlet.set_open(Openness::Serving);
        assert_eq!(outlet.refusal(), Some(Status::ProviderReplaced));
    }
}
