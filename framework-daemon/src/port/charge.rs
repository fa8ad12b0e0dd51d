//! A fault of a slot that somebody else saw: the executor of a reader, a model, a voter, a clock. It waits in a queue of the
//! blamed slot until that slot's executor takes it up, between callbacks.
//!
//! Bounded and without a lock, so that any thread may charge anybody, whatever state either is in.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crossbeam_queue::ArrayQueue;

use crate::model::chain::{self, Mark};
use crate::model::fault::{Fault, Stage};
use crate::model::limits::CHARGES;
use crate::model::symptom::{SeverityTable, Symptom};
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

    /// Takes note of a fault of that time that its executor will learn of by itself.
    fn suspect(&self, _symptom: Symptom, _at_ns: u64) {}
}

/// What others charge a slot with.
pub struct Charges {
    /// The slot's name.
    pub slot: &'static str,
    queue: ArrayQueue<Fault>,
    signal: Arc<Signal>,
    /// The symptoms that it answers ([`chain::answered`]).
    answered: u32,
    /// Since when it is the root of what happens further down: the numbers of a [`Mark`].
    first_ns: AtomicU64,
    last_ns: AtomicU64,
    seen_ns: AtomicU64,
}

impl Charges {
    /// None yet, against a slot with these rules; the signal is the slot's.
    #[must_use]
    pub fn new(slot: &'static str, signal: Arc<Signal>, rules: &SeverityTable) -> Self {
        let (queue, answered) = (ArrayQueue::new(CHARGES), chain::answered(rules));
        let [first_ns, last_ns, seen_ns] = [const { AtomicU64::new(0) }; 3];
        Self { slot, queue, signal, answered, first_ns, last_ns, seen_ns }
    }

    /// Since when the slot is a root.
    #[must_use]
    pub fn root(&self) -> Mark {
        let load = |time: &AtomicU64| time.load(Ordering::Acquire);
        Mark { first_ns: load(&self.first_ns), last_ns: load(&self.last_ns), seen_ns: load(&self.seen_ns) }
    }

    /// A fault that began then is answered now, by the slot's executor: the slot is a root, where its rules do something
    /// about it.
    pub fn take_up(&self, symptom: Symptom, onset_ns: u64) {
        if self.answered & chain::bit(symptom) != 0 {
            let Mark { first_ns, last_ns, seen_ns } = self.root().taken_up(onset_ns);
            // In this order: who reads in between finds a root that it would not find a moment earlier either.
            self.first_ns.store(first_ns, Ordering::Release);
            self.last_ns.store(last_ns, Ordering::Release);
            self.seen_ns.store(seen_ns, Ordering::Release);
        }
    }

    /// Nothing follows here from what was seen of it: it is another slot's consequence, or nothing new.
    pub fn leave(&self) {
        self.seen_ns.store(self.root().left().seen_ns, Ordering::Release);
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
        if fault.stage == Stage::Confirmed {
            self.suspect(fault.symptom, fault.at_ns);
        }
        let is_taken = self.queue.push(*fault).is_ok();
        if !is_taken {
            count_lost();
        }
        self.signal.ring(Ring::Charge);
        is_taken
    }

    fn suspect(&self, symptom: Symptom, at_ns: u64) {
        if self.answered & chain::bit(symptom) != 0 {
            let seen = |seen_ns| Some(Mark { seen_ns, ..Mark::NONE }.seen(at_ns).seen_ns);
            let _ = self.seen_ns.fetch_update(Ordering::AcqRel, Ordering::Acquire, seen);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::fault::{Evidence, ShortText};
    use crate::sys::bell::Bell;

    #[test]
    fn a_charge_rings_for_its_slot_and_a_full_queue_counts() {
        let bell = Bell::new();
        let signal = Signal::new(Arc::clone(&bell));
        signal.assign(5);
        let charges = Charges::new("a", Arc::clone(&signal), &SeverityTable::default());
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
