//! How all slots are, and what follows from what happens to one: the fault manager's memory. Pure: histories of it are played
//! by the million against a naive model (`scripts/histories`).

use super::decide::{Batch, Moves, decide};
use super::diagnose::{Own, Reason, Verdict, diagnose};
use super::graph::{Graph, Number};
use super::order::Verb;
use crate::model::fault::Outcome;

/// How all slots of a graph are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Situation {
    own: Vec<Own>,
    running: Vec<bool>,
    held: Vec<Option<Reason>>,
    /// A fault of its own stopped it, and was answered by the emergency stop.
    raised: Vec<bool>,
    /// The emergency stop is latched, for the fault of that number where it is known.
    emergency: Option<Option<u64>>,
}

/// An order makes no sense as the slot is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Senseless {
    /// A fault stopped it: it is reset, not started.
    Failed,
    /// No fault stopped it: there is nothing to reset.
    Sound,
}

/// Who is held now, or no longer: the reason before, and now.
pub type Change = (Number, Option<Reason>, Option<Reason>);

impl Situation {
    /// Slots, and after them voters, that are like this by themselves; of the slots these run.
    #[must_use]
    pub fn new(own: Vec<Own>, running: Vec<bool>) -> Self {
        let (held, raised) = (vec![None; own.len()], vec![false; own.len()]);
        Self { own, running, held, raised, emergency: None }
    }

    /// How a slot is by itself.
    #[must_use]
    pub fn own(&self, slot: Number) -> Own {
        self.own.get(slot).copied().unwrap_or(Own::Off)
    }

    /// True while a slot runs, or is in the middle of a recovery.
    #[must_use]
    pub fn runs(&self, slot: Number) -> bool {
        self.running.get(slot) == Some(&true)
    }

    /// Why a slot is held; `None`: it is not.
    #[must_use]
    pub fn held(&self, slot: Number) -> Option<Reason> {
        self.held.get(slot).copied().flatten()
    }

    /// A fault of a slot was answered like this; `root`: its sequence number, or that of the fault that it is a consequence
    /// of. False: nothing follows for others.
    #[must_use]
    pub fn fault(&mut self, slot: Number, outcome: Outcome, root: u64) -> bool {
        match outcome {
            Outcome::Stopped => self.find(slot, Own::Faulty(root), false),
            // Its stop was taken note of before, or lost on the way.
            Outcome::Recovered if matches!(self.own[slot], Own::Faulty(_)) => self.find(slot, Own::Wanted, true),
            Outcome::Recovered | Outcome::Ignored | Outcome::Failed | Outcome::Consequence => return false,
        }
        true
    }

    /// Too few members of a voter agree, which the fault of that number told; or enough of them.
    pub fn vote(&mut self, voter: Number, fault: Option<u64>) {
        self.own[voter] = fault.map_or(Own::Wanted, Own::Faulty);
    }

    /// A slot was found like this.
    pub fn find(&mut self, slot: Number, own: Own, runs: bool) {
        (self.own[slot], self.running[slot], self.raised[slot]) = (own, runs, false);
    }

    /// The fault that stopped a slot was answered by the emergency stop, and ends with it.
    pub fn raise(&mut self, slot: Number) {
        self.raised[slot] = matches!(self.own[slot], Own::Faulty(_));
    }

    /// An operator wants that of a slot.
    ///
    /// # Errors
    /// When it makes no sense.
    pub fn order(&mut self, slot: Number, verb: Verb) -> Result<(), Senseless> {
        self.own[slot] = match (verb, self.own[slot]) {
            (Verb::Stop, own @ Own::Faulty(_)) => own,
            (Verb::Stop, _) => Own::Off,
            (Verb::Start, Own::Faulty(_)) => return Err(Senseless::Failed),
            (Verb::Reset, Own::Faulty(_)) | (Verb::Start, _) => Own::Wanted,
            (Verb::Reset | Verb::Clear, _) => return Err(Senseless::Sound),
        };
        Ok(())
    }

    /// The emergency stop is latched, for the fault of that number where it is known; or it is not.
    pub fn latch(&mut self, graph: &Graph, latched: bool, root: Option<u64>) {
        self.emergency = latched.then_some(root);
        if latched {
            // Their executors stop them by themselves, which is more than a stop.
            let actuators = graph.nodes().iter().map(|node| node.is_actuator);
            self.running.iter_mut().zip(actuators).for_each(|(running, is_actuator)| *running &= !is_actuator);
        }
    }

    /// The operator took the emergency stop back: the actuators whose own faults it answered are to run again, too.
    /// One that another fault stopped is not: that is for a reset.
    pub fn clear(&mut self, graph: &Graph) {
        self.emergency = None;
        for (slot, node) in graph.nodes().iter().enumerate().take(self.own.len()) {
            if node.is_actuator && std::mem::take(&mut self.raised[slot]) && matches!(self.own[slot], Own::Faulty(_)) {
                self.own[slot] = Own::Wanted;
            }
        }
    }

    /// What is to be done now.
    #[must_use]
    pub fn settle(&self, graph: &Graph) -> (Vec<Verdict>, Moves) {
        let verdicts = diagnose(graph, &self.own, self.emergency);
        let moves = decide(graph, &self.running, &verdicts);
        (verdicts, moves)
    }

    /// A batch was stopped.
    pub fn stopped(&mut self, batch: &Batch) {
        batch.slots.iter().for_each(|slot| self.running[*slot] = false);
    }

    /// A slot of a batch was started; or it failed, and its fault is on its way.
    pub fn started(&mut self, slot: Number, failed: bool) {
        self.running[slot] = !failed;
        if failed {
            self.raised[slot] = false;
            self.own[slot] = Own::Faulty(0);
        }
    }

    /// Takes note of who is held now; returns what changed.
    #[must_use]
    pub fn hold(&mut self, verdicts: &[Verdict]) -> Vec<Change> {
        let mut changes = Vec::new();
        for (slot, verdict) in verdicts.iter().enumerate() {
            let reason = if let Verdict::Held(reason) = verdict { Some(*reason) } else { None };
            let before = std::mem::replace(&mut self.held[slot], reason);
            if before.is_some() != reason.is_some() {
                changes.push((slot, before, reason));
            }
        }
        changes
    }
}
