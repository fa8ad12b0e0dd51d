//! A time of bad values, debounced: suspected, confirmed, healed, cleared.
//!
//! One that is bad for `delay` is confirmed, which is the fault; one that is good for `delay` afterwards is cleared. What
//! happens in between is still the same fault: a value that comes and goes within its delay is neither many faults nor
//! none. Without a delay the first bad value confirms, and the first good one is the end.

use crate::model::fault::Stage;

/// Where it stands. One word, so that it can be kept where several threads write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Episode {
    phase: Phase,
    since_ns: u64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Phase {
    /// All is well.
    #[default]
    Good,
    /// Bad since then, for less than the delay.
    Suspected,
    /// Told of, and bad.
    Confirmed,
    /// Told of, and good since then, for less than the delay.
    Healed,
    /// As `Confirmed`, after it was healed and told of as such.
    Relapsed,
}

/// Bits of the phase in an episode's word; nanoseconds since the boot fit in the others for seventy years.
const PHASE_BITS: u32 = 3;

impl Episode {
    /// The next value was good, or bad, at that time: where it stands then, and what is to be told.
    #[must_use]
    pub fn after(self, is_bad: bool, now_ns: u64, delay_ns: u64) -> (Self, Option<Stage>) {
        let lasted = now_ns.saturating_sub(self.since_ns) >= delay_ns;
        let to = |phase| Self { phase, since_ns: now_ns };
        match (self.phase, is_bad) {
            (Phase::Good, false) => (self, None),
            (Phase::Good, true) if delay_ns == 0 => (to(Phase::Confirmed), Some(Stage::Confirmed)),
            (Phase::Good, true) => (to(Phase::Suspected), None),
            (Phase::Suspected, true) if lasted => (to(Phase::Confirmed), Some(Stage::Confirmed)),
            (Phase::Suspected | Phase::Confirmed | Phase::Relapsed, true) => (self, None),
            (Phase::Suspected, false) => (Self::GOOD, None),
            // At once the end of it.
            (Phase::Confirmed | Phase::Relapsed, false) if delay_ns == 0 => (Self::GOOD, Some(Stage::Healed)),
            (Phase::Confirmed, false) => (to(Phase::Healed), Some(Stage::Healed)),
            // That it heals is told once.
            (Phase::Relapsed, false) => (to(Phase::Healed), None),
            (Phase::Healed, true) => (to(Phase::Relapsed), None),
            (Phase::Healed, false) if lasted => (Self::GOOD, Some(Stage::Cleared)),
            (Phase::Healed, false) => (self, None),
        }
    }

    /// All is well.
    pub const GOOD: Self = Self { phase: Phase::Good, since_ns: 0 };

    /// As one word; 0: all is well.
    #[must_use]
    pub const fn to_word(self) -> u64 {
        (self.since_ns << PHASE_BITS) | self.phase as u64
    }

    /// From [`Self::to_word`].
    #[must_use]
    pub const fn from_word(word: u64) -> Self {
        let phase = match word & ((1 << PHASE_BITS) - 1) {
            1 => Phase::Suspected,
            2 => Phase::Confirmed,
            3 => Phase::Healed,
            4 => Phase::Relapsed,
            _ => Phase::Good,
        };
        Self { phase, since_ns: word >> PHASE_BITS }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn told(delay_ns: u64, values: &[(u64, bool)]) -> Vec<(u64, Stage)> {
        let (mut episode, mut told) = (Episode::default(), Vec::new());
        for (now_ns, is_bad) in values {
            let (next, stage) = episode.after(*is_bad, *now_ns, delay_ns);
            told.extend(stage.map(|stage| (*now_ns, stage)));
            episode = next;
        }
        told
    }

    #[test]
    fn suspected_confirmed_healed_cleared() {
        let values =
            [(10, true), (40, true), (60, true), (70, false), (90, true), (95, false), (140, false), (145, false)];
        assert_eq!(told(50, &values), [(60, Stage::Confirmed), (70, Stage::Healed), (145, Stage::Cleared)]);
        assert_eq!(told(50, &[(10, true), (40, false), (70, true), (100, true)]), [], "shorter than the delay");
        assert_eq!(told(0, &[(10, true), (11, true), (12, false)]), [(10, Stage::Confirmed), (12, Stage::Healed)]);
    }

    proptest! {
        /// Told in order, each once an episode, neither before its delay.
        #[test]
        fn each_stage_is_told_once_and_in_time(values in prop::collection::vec((any::<bool>(), 0..20u64), 0..300), delay in 0..50u64) {
            let (mut episode, mut now, mut last) = (Episode::default(), 1, None);
            let (mut bad_since, mut good_since) = (None, None);
            for (is_bad, gap) in values {
                now += gap;
                if is_bad { good_since = None; bad_since.get_or_insert(now); } else { bad_since = None; good_since.get_or_insert(now); }
                let (next, stage) = episode.after(is_bad, now, delay);
                prop_assert_eq!(Episode::from_word(next.to_word()), next);
                prop_assert!(!is_bad || next.to_word() != 0);
                match stage {
                    Some(Stage::Confirmed) => {
                        prop_assert!(is_bad && now - bad_since.unwrap() >= delay);
                        prop_assert!(last.is_none() || last == Some(Stage::Cleared) || delay == 0);
                    }
                    Some(Stage::Healed) => prop_assert!(!is_bad && last == Some(Stage::Confirmed)),
                    Some(Stage::Cleared) => {
                        prop_assert!(!is_bad && now - good_since.unwrap() >= delay && last == Some(Stage::Healed));
                    }
                    None => prop_assert!(bad_since.is_none_or(|since| now - since < delay) || last == Some(Stage::Confirmed) || last == Some(Stage::Healed)),
                }
                last = stage.or(last);
                episode = next;
            }
        }
    }
}
