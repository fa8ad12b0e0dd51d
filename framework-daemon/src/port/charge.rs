//! A fault of a slot that somebody else saw: the executor of a reader, a model, a voter, a clock. It waits in a queue of the
//! blamed slot until that slot's executor takes it up, between callbacks.
//!
//! Bounded and without a lock, so that any thread may charge anybody, whatever state either is in.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crossbeam_queue::ArrayQueue;

use crate::model::fault::Fault;
use crate::model::limits::CHARGES;
use crate::sys::bell::{Ring, Signal};

static LOST: AtomicU64 = AtomicU64::new(0);

/// Charges that found the queue of their slot full.
#[must_use]
pub fn lost() -> u64 {
    LOST.load(Ordering::Relaxed)
}

/// Counts one that found the fault manager's queue full.
pub(super) fn count_lost() {
    LOST.fetch_add(1, Ordering::Relaxed);
}

/// Whoever answers for what a port sends.
pub trait Accused: Send + Sync {
    /// Charges it with a fault, from any thread. False: it was lost, which is counted.
    fn charge(&self, fault: &Fault) -> bool;
}

/// What others charge a slot with.
pub struct Charges {
    queue: ArrayQueue<Fault>,
    signal: Arc<Signal>,
}

impl Charges {
    /// None yet; the signal is the slot's.
    #[must_use]
    pub fn new(signal: Arc<Signal>) -> Self {
        Self { queue: ArrayQueue::new(CHARGES), signal }
    }

    /// The next one. The slot's executor.
    #[must_use]
    pub fn next(&self) -> Option<Fault> {
        self.queue.pop()
    }
}

impl Accused for Charges {
    /// False: so many wait already.
    fn charge(&self, fault: &Fault) -> bool {
        let is_taken = self.queue.push(*fault).is_ok();
        if !is_taken {
            count_lost();
        }
        self.signal.ring(Ring::Charge);
        is_taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::fault::{Evidence, ShortText};
    use crate::model::symptom::Symptom;
    use crate::sys::bell::Bell;

    #[test]
    fn a_charge_rings_for_its_slot_and_a_full_queue_counts() {
        let bell = Bell::new();
        let signal = Signal::new(Arc::clone(&bell));
        signal.assign(5);
        let charges = Charges::new(Arc::clone(&signal));
        let fault = |at| Fault::told(Symptom::Vote, at, Evidence::Text { message: ShortText::new("outvoted") });
        let before = lost();
        assert!((0..CHARGES as u64).all(|at| charges.charge(&fault(at))));
        assert!(!charges.charge(&fault(99)));
        assert!(lost() > before);
        assert_eq!((bell.next_ready(), bell.next_ready()), (Some(5), None));
        assert!(signal.take().has(Ring::Charge));
        let times: Vec<_> = std::iter::from_fn(|| charges.next()).map(|fault| fault.at_ns).collect();
        assert!(times.iter().copied().eq(0..CHARGES as u64), "in their order: {times:?}");
    }
}
