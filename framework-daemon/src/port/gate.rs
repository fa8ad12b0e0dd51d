//! Whether a port may wait. Two gates, both of which must be open: the author's, and that of its slot, which is closed
//! while the slot is to come to an end.
//!
//! A gate is a level: it stays as it was set. Closings are counted besides, so that one that is opened again at once
//! still ends the waits that had begun.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// The gates of one client port.
pub struct Gate {
    author: AtomicBool,
    slot: AtomicBool,
    closings: AtomicU32,
}

impl Default for Gate {
    fn default() -> Self {
        Self { author: AtomicBool::new(true), slot: AtomicBool::new(true), closings: AtomicU32::new(0) }
    }
}

impl Gate {
    /// Sets the author's gate.
    pub fn set_author(&self, open: bool) {
        self.set(&self.author, open);
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
        self.author.load(Ordering::SeqCst) && self.slot.load(Ordering::SeqCst) && self.closings() == closings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_must_be_open_and_a_closing_is_remembered() {
        let gate = Gate::default();
        let before = gate.closings();
        assert!(gate.lets_wait(before));
        gate.set_author(false);
        gate.set_slot(false);
        gate.set_author(true);
        assert!(!gate.lets_wait(gate.closings()), "the other is closed");
        gate.set_slot(true);
        assert!(!gate.lets_wait(before), "it was closed meanwhile");
        assert!(gate.lets_wait(gate.closings()));
        gate.set_author(false);
        gate.set_author(false);
        gate.set_author(true);
        assert!(gate.lets_wait(gate.closings()), "flags, not counters");
    }
}
