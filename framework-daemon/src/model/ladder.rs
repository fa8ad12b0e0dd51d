//! The answer to each symptom, compiled from the profile at load; at the moment of a fault it is looked up, not thought out.
//!
//! The ladder: ignore, or reset within the restart intensity, then replace by the next secondary, then stop. Pure: no
//! clock, lock, log or thread; the executor that saw the fault walks it on the spot.

use std::collections::VecDeque;
use std::time::Duration;

use serde::Serialize;

use super::limits::{RESETS_DEFAULT, RESETS_MAX, RESETS_WINDOW};
use super::symptom::{Severity, SeverityTable, Symptom};
use super::time::nanoseconds;

/// What is done about a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Answer {
    /// Nothing; it is journaled.
    Ignore,
    /// The same instance is reset, or a fresh one of the same class takes its place where it may not be entered again.
    Reset,
    /// The next secondary takes the slot over.
    Replace,
    /// The slot stops.
    Stop,
    /// The robot is brought to its safe state, and the slot stops.
    Emergency,
    /// Nothing yet: it is a consequence, and what is done about its root may be enough.
    Await,
    /// A spare was to be prepared; the slot itself was not touched.
    Prepare,
}

/// The rules of one slot with their memory.
#[derive(Clone, Debug)]
pub struct Ladder {
    severity: SeverityTable,
    limit: usize,
    within_ns: u64,
    secondaries: usize,
    used: usize,
    // Room for all that the intensity allows is made at load.
    resets: VecDeque<u64>,
}

impl Ladder {
    /// Rules with `limit` resets within `within` and that many secondaries. Without an intensity a default holds: a slot
    /// that fails again and again must not be reset for ever.
    #[must_use]
    pub fn new(severity: SeverityTable, intensity: Option<(u32, Duration)>, secondaries: usize) -> Self {
        let (limit, within) = intensity.unwrap_or((RESETS_DEFAULT, RESETS_WINDOW));
        let limit = limit.min(RESETS_MAX) as usize;
        Self {
            severity,
            limit,
            within_ns: nanoseconds(within),
            secondaries,
            used: 0,
            resets: VecDeque::with_capacity(limit),
        }
    }

    /// The severity of a symptom.
    #[must_use]
    pub const fn severity(&self, symptom: Symptom) -> Severity {
        self.severity.get(symptom)
    }

    /// The answer to `symptom` at `now_ns`; remembers it.
    pub fn answer(&mut self, symptom: Symptom, now_ns: u64) -> Answer {
        match self.severity.get(symptom) {
            Severity::Ignore => Answer::Ignore,
            Severity::Reset => self.reset_or_further(now_ns),
            Severity::Stop => Answer::Stop,
            Severity::Emergency => Answer::Emergency,
        }
    }

    /// The answer where a recovery failed itself: one step further, never the same again.
    pub fn further(&mut self) -> Answer {
        if self.used < self.secondaries {
            self.used += 1;
            // The successor starts with a clean record.
            self.resets.clear();
            return Answer::Replace;
        }
        Answer::Stop
    }

    /// Forgets past resets: an operator looked after it.
    pub fn forgive(&mut self) {
        self.resets.clear();
    }

    /// Index of the secondary that is in use; `None`: the primary.
    #[must_use]
    pub const fn secondary(&self) -> Option<usize> {
        self.used.checked_sub(1)
    }

    fn reset_or_further(&mut self, now_ns: u64) -> Answer {
        self.forget_before(now_ns.saturating_sub(self.within_ns));
        if self.resets.len() >= self.limit {
            return self.further();
        }
        self.resets.push_back(now_ns);
        Answer::Reset
    }

    fn forget_before(&mut self, horizon_ns: u64) {
        while self.resets.front().is_some_and(|at| *at < horizon_ns) {
            self.resets.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ladder(limit: u32, within: Duration, secondaries: usize) -> Ladder {
        let mut severity = SeverityTable::opros_default();
        severity.set(Symptom::CrashSegv, Severity::Reset);
        Ladder::new(severity, Some((limit, within)), secondaries)
    }

    #[test]
    fn beyond_the_intensity_the_ladder_goes_on() {
        let mut ladder = ladder(2, Duration::from_secs(10), 1);
        let answers: Vec<_> = (1..=6).map(|second| ladder.answer(Symptom::CrashSegv, second * 1_000_000_000)).collect();
        use Answer::{Replace, Reset, Stop};
        assert_eq!(answers, [Reset, Reset, Replace, Reset, Reset, Stop]);
    }

    #[test]
    fn a_limit_of_zero_replaces_at_once() {
        assert_eq!(ladder(0, Duration::from_secs(1), 1).answer(Symptom::CrashSegv, 5), Answer::Replace);
    }

    #[test]
    fn without_an_intensity_resets_are_bounded_all_the_same() {
        let mut severity = SeverityTable::opros_default();
        severity.set(Symptom::CrashSegv, Severity::Reset);
        let mut ladder = Ladder::new(severity, None, 0);
        let resets = (0..100).take_while(|at| ladder.answer(Symptom::CrashSegv, *at) == Answer::Reset).count();
        assert_eq!(resets, RESETS_DEFAULT as usize);
    }

    #[test]
    fn without_rules_a_crash_stops_as_in_opros() {
        let mut ladder = Ladder::new(SeverityTable::opros_default(), None, 0);
        assert_eq!(ladder.answer(Symptom::CrashPanic, 1), Answer::Stop);
        assert_eq!(ladder.answer(Symptom::Validity, 1), Answer::Ignore);
    }

    proptest! {
        /// Never more resets within the window than allowed, between two replacements; never more replacements than secondaries.
        #[test]
        fn intensity_holds(limit in 0..5u32, within in 1..50u64, secondaries in 0..4usize, gaps in prop::collection::vec(0..30u64, 0..300)) {
            let mut ladder = ladder(limit, Duration::from_nanos(within), secondaries);
            let (mut now, mut resets, mut replaced) = (1000, Vec::new(), 0);
            for gap in gaps {
                now += gap;
                match ladder.answer(Symptom::CrashSegv, now) {
                    Answer::Reset => {
                        resets.push(now);
                        let recent = resets.iter().filter(|at| **at + within >= now).count();
                        prop_assert!(recent <= limit as usize);
                    }
                    Answer::Replace => { replaced += 1; resets.clear(); }
                    Answer::Stop => break,
                    Answer::Ignore | Answer::Emergency | Answer::Await | Answer::Prepare => prop_assert!(false),
                }
            }
            prop_assert!(replaced <= secondaries);
        }
    }
}
