//! A value outside its range, and for how long: the paper's `min`, `max` and `delay`.

/// Inclusive bounds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
}

impl Bounds {
    /// The bound that `value` crosses; `None`: it lies within. What is not a number lies nowhere.
    #[must_use]
    pub fn crossed(&self, value: f64) -> Option<f64> {
        if value < self.min {
            Some(self.min)
        } else if value > self.max {
            Some(self.max)
        } else if value.is_nan() {
            Some(f64::NAN)
        } else {
            None
        }
    }
}

/// A time of bad values: reported once, when it has lasted `delay`; the next one begins after a good value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Episode {
    since_ns: Option<u64>,
    reported: bool,
}

impl Episode {
    /// Takes note of one value; true when this is the moment to report.
    pub fn note(&mut self, bad: bool, now_ns: u64, delay_ns: u64) -> bool {
        if !bad {
            *self = Self::default();
            return false;
        }
        let since = *self.since_ns.get_or_insert(now_ns);
        let due = !self.reported && now_ns.saturating_sub(since) >= delay_ns;
        self.reported |= due;
        due
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bounds_are_inclusive_and_nan_is_never_within() {
        let bounds = Bounds { min: 3.0, max: 300.0 };
        assert_eq!(bounds.crossed(3.0), None);
        assert_eq!(bounds.crossed(0.0), Some(3.0));
        assert_eq!(bounds.crossed(300.1), Some(300.0));
        assert!(bounds.crossed(f64::NAN).is_some());
    }

    proptest! {
        /// One report an episode, never before the delay.
        #[test]
        fn an_episode_is_reported_once(values in prop::collection::vec((any::<bool>(), 0..20u64), 0..200), delay in 0..50u64) {
            let (mut episode, mut now, mut since, mut reports) = (Episode::default(), 0, None, 0);
            for (bad, gap) in values {
                now += gap;
                if bad { since.get_or_insert(now); } else { since = None; reports = 0; }
                if episode.note(bad, now, delay) {
                    reports += 1;
                    prop_assert!(bad && now - since.unwrap() >= delay);
                }
                prop_assert!(reports <= 1);
            }
        }
    }
}
