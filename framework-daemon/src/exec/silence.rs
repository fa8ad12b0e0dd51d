//! Silence at the inputs of a slot: its executor looks when the newest value can have become too old, and charges the
//! writers. An input that nobody is connected to blames nobody.

use super::member::Member;
use crate::detect::freshness::{Finding, Silence};
use crate::model::fault::{Evidence, Fault, Label, Stage};
use crate::model::lifecycle::State;
use crate::model::symptom::Symptom;
use crate::port::hearing::Hearing;
use crate::port::input::InPort;
use crate::sys::clock;

/// An input whose silence is a fault.
pub struct Vigil {
    /// Its place among the slot's inputs.
    input: usize,
    silence: Silence,
    due_ns: u64,
}

/// One for each input with a `max_age`.
#[must_use]
pub fn vigils(inputs: &[impl AsRef<InPort>]) -> Vec<Vigil> {
    let watched = inputs.iter().enumerate().filter(|(_, port)| port.as_ref().hearing().is_some());
    watched.map(|(input, _)| Vigil { input, silence: Silence::default(), due_ns: 0 }).collect()
}

impl Member {
    /// True where silence at one of its inputs is a fault.
    pub(super) const fn is_watchful(&self) -> bool {
        !self.vigils.is_empty()
    }

    /// The slot works from now on: what came before, or did not, counts no more.
    pub(super) fn begin_vigils(&mut self) {
        let now_ns = clock::now_ns();
        for vigil in &mut self.vigils {
            let Some(hearing) = self.slot.inputs.get(vigil.input).and_then(|port| port.hearing()) else { continue };
            hearing.begin(now_ns);
            vigil.due_ns = now_ns.saturating_add(hearing.max_age_ns);
        }
    }

    /// When to look at its inputs next.
    pub(super) fn next_look_ns(&self) -> Option<u64> {
        let looks = self.vigils.iter().map(|vigil| vigil.due_ns);
        looks.min().filter(|_| self.state() == State::Active)
    }

    /// Looks at the inputs whose time has come.
    pub(super) fn look_for_silence(&mut self, now_ns: u64) {
        let (name, inputs) = (self.slot.name, &self.slot.inputs);
        for vigil in self.vigils.iter_mut().filter(|vigil| vigil.due_ns <= now_ns) {
            if let Some(port) = inputs.get(vigil.input)
                && let Some(hearing) = port.hearing()
            {
                vigil.look(name, port, hearing);
            }
        }
    }
}

impl Vigil {
    fn look(&mut self, slot: &str, port: &InPort, hearing: &Hearing) {
        let arrivals = hearing.arrivals();
        // After what has arrived was looked at: a value is never from the future.
        let now_ns = clock::now_ns();
        let (mut silence, told) = (self.silence, |silent_ns| Evidence::Silence {
            port: Label::of(format_args!("{slot}.{}", port.name)),
            silent_ns,
            max_age_ns: hearing.max_age_ns,
        });
        let (finding, next_ns) = silence.look(hearing.max_age_ns, arrivals, now_ns);
        self.due_ns = next_ns;
        let charged = match finding {
            None => true,
            Some(Finding::Stale { .. }) if !port.is_awaited() => {
                // Nobody is to send anything: it is waited for from now on, should that change.
                hearing.begin(now_ns);
                return;
            }
            Some(Finding::Stale { silent_ns }) => {
                let at_ns = now_ns - silent_ns + hearing.max_age_ns;
                port.charge_writers(&Fault { at_ns, ..Fault::told(Symptom::Stale, now_ns, told(silent_ns)) })
            }
            Some(Finding::Healed { at_ns }) => {
                let silent_ns = at_ns.saturating_sub(self.silence.since_ns());
                let fault = Fault { at_ns, ..Fault::told(Symptom::Stale, now_ns, told(silent_ns)) };
                port.charge_writers(&Fault { stage: Stage::Healed, ..fault })
            }
        };
        // Where the connections are being changed all the time nobody was charged: the next look will.
        if charged {
            self.silence = silence;
        }
    }
}
