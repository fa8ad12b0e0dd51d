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

/// A watch over one input.
#[derive(Debug, Default)]
pub struct Vigil {
    silence: Silence,
    due_ns: u64,
}

/// An input of a slot whose silence is a fault.
pub struct Watched {
    /// Its place among the slot's inputs.
    input: usize,
    vigil: Vigil,
}

/// One for each input with a `max_age`.
#[must_use]
pub fn watched(inputs: &[impl AsRef<InPort>]) -> Vec<Watched> {
    let expecting = inputs.iter().enumerate().filter(|(_, port)| port.as_ref().hearing().is_some());
    expecting.map(|(input, _)| Watched { input, vigil: Vigil::default() }).collect()
}

impl Member {
    /// True where silence at one of its inputs is a fault.
    pub(super) const fn is_watchful(&self) -> bool {
        !self.watched.is_empty()
    }

    /// The slot works from now on: what came before, or did not, counts no more.
    pub(super) fn begin_to_watch(&mut self) {
        let now_ns = clock::now_ns();
        for Watched { input, vigil } in &mut self.watched {
            let Some(hearing) = self.slot.inputs.get(*input).and_then(|port| port.hearing()) else { continue };
            hearing.begin(now_ns);
            vigil.due_ns = now_ns.saturating_add(hearing.max_age_ns);
        }
    }

    /// When to look at its inputs next.
    pub(super) fn next_look_ns(&self) -> Option<u64> {
        let looks = self.watched.iter().map(|watched| watched.vigil.due_ns);
        looks.min().filter(|_| self.state() == State::Active)
    }

    /// Looks at the inputs whose time has come.
    pub(super) fn look_for_silence(&mut self, now_ns: u64) {
        let (name, inputs) = (self.slot.name, &self.slot.inputs);
        for Watched { input, vigil } in self.watched.iter_mut().filter(|watched| watched.vigil.due_ns <= now_ns) {
            if let Some(port) = inputs.get(*input) {
                vigil.look(|| Label::of(format_args!("{name}.{}", port.name)), port);
            }
        }
    }
}

impl Vigil {
    /// When to look next.
    #[must_use]
    pub const fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// Looks at the input, and charges its writers with what it finds. The name is asked for where there is something to tell.
    pub fn look(&mut self, name: impl Fn() -> Label, port: &InPort) {
        let Some(hearing) = port.hearing() else { return };
        let arrivals = hearing.arrivals();
        // After what has arrived was looked at: a value is never from the future.
        let now_ns = clock::now_ns();
        let mut silence = self.silence;
        let (finding, next_ns) = silence.look(hearing.max_age_ns, arrivals, now_ns);
        self.due_ns = next_ns;
        let told = |silent_ns| Evidence::Silence { port: name(), silent_ns, max_age_ns: hearing.max_age_ns };
        let charged = match finding {
            None => true,
            Some(Finding::Stale { .. }) if !port.is_awaited() => return hearing.begin(now_ns),
            Some(Finding::Stale { silent_ns }) => {
                let fault = Fault::told(Symptom::Stale, now_ns, told(silent_ns));
                port.charge_writers(&Fault { at_ns: happened_ns(hearing, now_ns, silent_ns), ..fault })
            }
            Some(Finding::Healed { at_ns }) => {
                let silent_ns = at_ns.saturating_sub(self.silence.since_ns());
                let fault = Fault::told(Symptom::Stale, now_ns, told(silent_ns));
                port.charge_writers(&Fault { at_ns, stage: Stage::Healed, ..fault })
            }
        };
        // Where the connections are being changed all the time nobody was charged: the next look will.
        if charged {
            self.silence = silence;
        }
    }
}

/// When a silence became too long.
const fn happened_ns(hearing: &Hearing, now_ns: u64, silent_ns: u64) -> u64 {
    now_ns.saturating_sub(silent_ns).saturating_add(hearing.max_age_ns)
}
