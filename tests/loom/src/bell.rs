//! `sys::bell` for the checker of calls: whoever is rung for is woken, so that a ring that is missing is a deadlock that the
//! checker reports.

use crate::wake::Waker;

/// Why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ring {
    /// Somebody asks for a service.
    Serve,
    /// What is waited for may be there.
    Wait,
}

/// Of one that waits.
#[derive(Debug, Default)]
pub struct Signal(Waker);

impl Signal {
    /// Wakes it.
    pub fn ring(&self, _: Ring) {
        self.0.wake();
    }

    /// Waits for a ring since the last one.
    pub fn wait(&self) {
        self.0.wait_until(None);
    }
}
