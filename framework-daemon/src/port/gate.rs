//! Whether a port may wait. Three gates, all of which must be open: the author's for the port, the author's for the whole
//! component, and that of its slot, which is closed while the slot is to come to an end.
//!
//! A gate is a level: it stays as it was set. Closings are counted besides, so that one that is opened again at once
//! still ends the waits that had begun.

use component_sdk::abi::calls::Whose;

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
