//! Silence: nothing arrived at a port for longer than its `max_age`.
//!
//! Not a look at every value, nor a look at the port in every cycle: whoever reads looks when the newest value can have
//! become too old at the earliest, and is told when to look next.

/// What a port knows of its arrivals, at one look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Arrivals {
    /// When the newest value arrived, in nanoseconds; 0: none yet.
    pub heard_ns: u64,
    /// Since when values are waited for: the start of the reader, the connection, or what the writer was reset for.
    pub since_ns: u64,
}

impl Arrivals {
    /// Since when it has been silent.
    #[must_use]
    pub const fn silent_since_ns(&self) -> u64 {
        if self.heard_ns > self.since_ns { self.heard_ns } else { self.since_ns }
    }
}

/// What a look found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    /// It has been silent for longer than it may; told once for each silence.
    Stale {
        /// Time without a value, in nanoseconds.
        silent_ns: u64,
    },
    /// A silence that was told of is over.
    Healed {
        /// When the first value arrived, in nanoseconds.
        at_ns: u64,
    },
}

/// A silence that was told of, by what was known of the port then.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silence(Option<Arrivals>);

impl Silence {
    /// Looks at a port, not before the time that the last look named; returns what is to be told, and when to look next.
    pub fn look(&mut self, max_age_ns: u64, arrivals: Arrivals, now_ns: u64) -> (Option<Finding>, u64) {
        if let Some(told) = self.0 {
            if arrivals.heard_ns > told.heard_ns {
                self.0 = None;
                // Whether it is silent again by now the next look finds, which is due at once then.
                let next_ns = arrivals.silent_since_ns().saturating_add(max_age_ns);
                return (Some(Finding::Healed { at_ns: arrivals.heard_ns }), next_ns);
            }
            if arrivals.since_ns <= told.since_ns {
                return (None, now_ns.saturating_add(max_age_ns));
            }
            self.0 = None;
        }
        let silent_ns = now_ns.saturating_sub(arrivals.silent_since_ns());
        if silent_ns < max_age_ns {
            return (None, arrivals.silent_since_ns().saturating_add(max_age_ns));
        }
        self.0 = Some(arrivals);
        (Some(Finding::Stale { silent_ns }), now_ns.saturating_add(max_age_ns))
    }

    /// Since when the silence has lasted that was told of; 0: none.
    #[must_use]
    pub fn since_ns(&self) -> u64 {
        self.0.map_or(0, |told| told.silent_since_ns())
    }

    /// True while a silence lasts that was told of.
    #[must_use]
    pub const fn is_told(&self) -> bool {
        self.0.is_some()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn it_counts_from_the_start_and_not_from_time_zero() {
        let mut silence = Silence::default();
        let arrivals = Arrivals { heard_ns: 0, since_ns: 1_000 };
        assert_eq!(silence.look(100, arrivals, 1_050), (None, 1_100));
        assert_eq!(silence.look(100, arrivals, 1_100), (Some(Finding::Stale { silent_ns: 100 }), 1_200));
        assert_eq!(silence.look(100, arrivals, 1_200), (None, 1_300), "once");
        let heard = Arrivals { heard_ns: 1_250, ..arrivals };
        assert_eq!(silence.look(100, heard, 1_300), (Some(Finding::Healed { at_ns: 1_250 }), 1_350));
        assert_eq!(silence.look(100, heard, 1_350).0, Some(Finding::Stale { silent_ns: 100 }));
        let anew = Arrivals { since_ns: 1_360, ..heard };
        assert_eq!(silence.look(100, anew, 1_450), (None, 1_460), "its writer was reset");
        assert_eq!(silence.look(100, anew, 1_460).0, Some(Finding::Stale { silent_ns: 100 }));
    }

    #[derive(Clone, Debug)]
    enum Step {
        Wait(u64),
        Value,
        Anew,
    }

    proptest! {
        /// Against a model that looks at every nanosecond: each silence told once, never early, at most one look late.
        #[test]
        fn every_silence_is_told_once(
            max_age in 1..20u64,
            steps in prop::collection::vec(
                prop_oneof![(1..40u64).prop_map(Step::Wait), Just(Step::Value), Just(Step::Anew)], 0..200)
        ) {
            let (mut silence, mut arrivals, mut now) = (Silence::default(), Arrivals { heard_ns: 0, since_ns: 1_000 }, 1_000u64);
            let (mut due, mut told) = (now + max_age, None);
            for step in steps {
                match step {
                    // Only then has the clock moved: no two things happen at one moment.
                    Step::Value => { now += 1; arrivals.heard_ns = now; }
                    Step::Anew => { now += 1; arrivals.since_ns = now; }
                    Step::Wait(time) => for _ in 0..time {
                        now += 1;
                        if now < due { continue; }
                        let (finding, next) = silence.look(max_age, arrivals, now);
                        let silent = now - arrivals.silent_since_ns();
                        match finding {
                            Some(Finding::Stale { silent_ns }) => {
                                prop_assert!(silent_ns == silent && silent >= max_age);
                                prop_assert!(told != Some(arrivals.silent_since_ns()), "one fault a silence");
                                told = Some(arrivals.silent_since_ns());
                            }
                            Some(Finding::Healed { at_ns }) => {
                                prop_assert!(told.is_some_and(|since| since < at_ns) && at_ns == arrivals.heard_ns);
                            }
                            None => prop_assert!(silence.is_told() || silent < max_age),
                        }
                        prop_assert!(next >= now.min(arrivals.silent_since_ns() + max_age) && next <= now + max_age);
                        due = next;
                    }
                }
            }
            // Nothing more happens: two looks later it is known.
            for _ in 0..3 {
                now = now.max(due);
                due = silence.look(max_age, arrivals, now).1;
            }
            now = now.max(due).max(arrivals.silent_since_ns() + max_age);
            let _ = silence.look(max_age, arrivals, now);
            prop_assert!(silence.is_told());
        }
    }
}
