//! Whether a port may wait. Three gates, all of which must be open: the author's for the port, the author's for the whole
//! component, and that of its slot, which is closed while the slot is to come to an end.
//!
//! A gate is a level: it stays as it was set. Closings are counted besides, so that one that is opened again at once
//! still ends the waits that had begun.

use component_sdk::abi::calls::{Wait, Whose};
use component_sdk::status::Status;

use super::wait::Place;
use crate::model::limits::DURATION_MAX;
use crate::model::time::nanoseconds;
use crate::sys::shared::{AtomicBool, AtomicU32, Ordering};

/// The gates of one client port.
pub struct Gate {
    port: AtomicBool,
    component: AtomicBool,
    slot: AtomicBool,
    closings: AtomicU32,
}

impl Default for Gate {
    fn default() -> Self {
        let open = || AtomicBool::new(true);
        Self { port: open(), component: open(), slot: open(), closings: AtomicU32::new(0) }
    }
}

impl Gate {
    /// Sets the author's gate for the port, or for the whole component.
    pub fn set_author(&self, whose: Whose, open: bool) {
        self.set(if whose == Whose::Port { &self.port } else { &self.component }, open);
    }

    /// Opens the author's gates: those of an instance that is gone.
    pub fn open_authors(&self) {
        self.port.store(true, Ordering::SeqCst);
        self.component.store(true, Ordering::SeqCst);
    }

    /// Sets the slot's gate.
    pub fn set_slot(&self, open: bool) {
        self.set(&self.slot, open);
    }

    fn set(&self, gate: &AtomicBool, open: bool) {
        gate.store(open, Ordering::SeqCst);
        if !open {
            self.closings.fetch_add(1, Ordering::SeqCst);
        }
    }

    /// How often it was closed: what a wait remembers when it begins.
    #[must_use]
    pub fn closings(&self) -> u32 {
        self.closings.load(Ordering::SeqCst)
    }

    /// True while a wait that began at that count may go on.
    #[must_use]
    pub fn lets_wait(&self, closings: u32) -> bool {
        let gates = [&self.port, &self.component, &self.slot];
        gates.iter().all(|gate| gate.load(Ordering::SeqCst)) && self.closings() == closings
    }
}

impl Gate {
    /// The loop of every wait, for whoever has looked at what it waits for: lets others run until `look` finds an end, or
    /// the gate is closed, or the time is over. What is there is given out, whatever came after it.
    ///
    /// # Errors
    /// What `look` found, `Cancelled`, `Timeout`.
    pub(super) fn wait<T>(
        &self,
        closings: u32,
        until_ns: u64,
        place: &impl Place,
        mut look: impl FnMut() -> Option<Result<T, Status>>,
    ) -> Result<T, Status> {
        loop {
            place.park(until_ns).map_err(|_| Status::Cancelled)?;
            if let Some(end) = look() {
                return end;
            }
            if !self.lets_wait(closings) {
                return Err(Status::Cancelled);
            }
            if place.now_ns() >= until_ns {
                return Err(Status::Timeout);
            }
        }
    }
}

/// How long is waited at most, in nanoseconds: as asked for, or so long where the author said nothing.
pub(super) fn patience_ns(wait: Wait, default_ns: u64) -> u64 {
    let time_ns = if wait == Wait::DEFAULT { default_ns } else { wait.0 };
    time_ns.min(nanoseconds(DURATION_MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_must_be_open_and_a_closing_is_remembered() {
        let gate = Gate::default();
        let before = gate.closings();
        assert!(gate.lets_wait(before));
        gate.set_author(Whose::Port, false);
        gate.set_slot(false);
        gate.set_author(Whose::Port, true);
        assert!(!gate.lets_wait(gate.closings()), "the other is closed");
        gate.set_slot(true);
        assert!(!gate.lets_wait(before), "it was closed meanwhile");
        assert!(gate.lets_wait(gate.closings()));
        gate.set_author(Whose::Port, false);
        gate.set_author(Whose::Port, false);
        gate.set_author(Whose::Port, true);
        assert!(gate.lets_wait(gate.closings()), "flags, not counters");
        gate.set_author(Whose::Component, false);
        gate.set_author(Whose::Port, true);
        assert!(!gate.lets_wait(gate.closings()), "each has its own");
        gate.open_authors();
        assert!(gate.lets_wait(gate.closings()));
    }
}
