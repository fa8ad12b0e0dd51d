//! A model and its target, heard at their outputs and compared where either of them writes.

use std::sync::{Arc, Mutex, PoisonError};

use super::charge::Accused;
use super::tap::{Heard, Probe, Tap};
use crate::detect::model_diff::{Change, Comparison, Demand, Reading, Side};
use crate::model::fault::{Evidence, Fault, Label, Stage};
use crate::model::symptom::Symptom;

/// What is compared with what.
pub struct Comparer {
    /// What it is, in words: `model expected.counts of board.encoders`.
    name: String,
    /// The target's slot and port.
    port: Label,
    field: Label,
    blamed: Arc<dyn Accused>,
    // Held for some hundred instructions over plain numbers: no memory of a plugin is touched meanwhile.
    state: Mutex<State>,
}

struct State {
    comparison: Comparison,
    last: Option<Reading>,
    /// How many values came from the target, and from the model.
    heard: [u64; 2],
}

impl Comparer {
    /// One that has heard nothing yet, and charges the target's slot.
    #[must_use]
    pub fn new(name: String, target: Label, field: &str, demand: Demand, blamed: Arc<dyn Accused>) -> Arc<Self> {
        let state = Mutex::new(State { comparison: Comparison::new(demand), last: None, heard: [0; 2] });
        Arc::new(Self { name, port: target, field: Label::new(field), blamed, state })
    }

    /// The newest comparison; `None`: there was none.
    #[must_use]
    pub fn last(&self) -> Option<Reading> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).last
    }

    /// Its ear at one of the two outputs.
    #[must_use]
    pub fn ear(self: &Arc<Self>, side: Side, probe: Probe) -> Arc<dyn Tap> {
        Arc::new(Ear { comparer: Arc::clone(self), side, probe })
    }

    fn note(&self, side: Side, value: f64, at_ns: u64) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.heard[side as usize] += 1;
        let demand = *state.comparison.demand();
        let reading = state.comparison.note(side, value, at_ns);
        state.last = reading.or(state.last);
        drop(state);
        if let Some(reading) = reading
            && let Some(change) = reading.change
        {
            self.tell(&reading, change, &demand, at_ns);
        }
    }

    fn tell(&self, reading: &Reading, change: Change, demand: &Demand, now_ns: u64) {
        let evidence = Evidence::Model {
            port: self.port,
            field: self.field,
            target: reading.target,
            model: reading.model,
            difference: reading.difference(),
            threshold: demand.threshold,
            window_ns: demand.window_ns,
        };
        let stage = if change == Change::Parted { Stage::Confirmed } else { Stage::Healed };
        // One that is lost is counted.
        self.blamed.charge(&Fault { stage, ..Fault::told(Symptom::Model, now_ns, evidence) });
    }
}

struct Ear {
    comparer: Arc<Comparer>,
    side: Side,
    probe: Probe,
}

impl Tap for Ear {
    fn name(&self) -> &str {
        &self.comparer.name
    }

    fn heard(&self, heard: &Heard<'_>) {
        // Before anything is locked. A sequence that is too short has nothing to say that agrees with anything.
        let value = heard.number(&self.probe).unwrap_or(f64::NAN);
        self.comparer.note(self.side, value, heard.at_ns());
    }

    fn count(&self) -> u64 {
        self.comparer.state.lock().unwrap_or_else(PoisonError::into_inner).heard[self.side as usize]
    }

    fn begins_anew(&self) {
        self.comparer.state.lock().unwrap_or_else(PoisonError::into_inner).comparison.begin(self.side);
    }
}
