//! Which raises of the emergency stop are written down with what they were for: an operator clears what he could know of. Pure.
//!
//! A raise is told twice, in either order: by whoever raised it, at once, and by the fault that it was raised for, which comes
//! with its recovery. While one of the two is missing nobody knows of it.

use std::collections::VecDeque;

use crate::sys::latch::{Cause, Mark};

/// Faults that are kept in mind for raises that are told later; they are a moment apart.
const WRITTEN: usize = 64;

/// A fault by whom and when it was, as both know it.
type Fault = (&'static str, u64);

/// The raises of the latch of late.
#[derive(Clone, Debug, Default)]
pub struct Raises {
    /// The latch that the others are of.
    since_us: u64,
    /// Raises that were told.
    heard: u64,
    /// Those of them whose faults are not written down yet.
    open: Vec<Fault>,
    /// Faults with their numbers in the journal, of raises that are told and such that are not yet.
    written: VecDeque<(Fault, u64)>,
    /// What the first was for in this run, and the newest.
    first: Option<Cause>,
    newest: Option<Cause>,
    /// An operator was told of all up to that one, as far as anybody knows of them.
    shown: Option<Mark>,
}

impl Raises {
    /// A raise was told.
    pub fn hear(&mut self, mark: Mark, slot: &'static str, at_ns: u64) {
        if self.since_us > mark.since_us() {
            // Of a latch before, told late.
            return;
        }
        self.begin(mark);
        self.heard += 1;
        if self.number_of(slot, at_ns).is_none() {
            self.open.push((slot, at_ns));
        }
    }

    /// Its fault is written down under that number.
    pub fn record(&mut self, slot: &'static str, at_ns: u64, number: u64) {
        self.open.retain(|open| *open != (slot, at_ns));
        if self.written.len() == WRITTEN {
            self.written.pop_front();
        }
        self.written.push_back(((slot, at_ns), number));
    }

    /// The number in the journal of the fault that a raise was for.
    #[must_use]
    pub fn number_of(&self, slot: &str, at_ns: u64) -> Option<u64> {
        let of_it = |(fault, number): &(Fault, u64)| (*fault == (slot, at_ns)).then_some(*number);
        self.written.iter().rev().find_map(of_it)
    }

    /// What it was for; `now`: the latch as it is.
    pub fn explain(&mut self, now: Mark, cause: &Cause) {
        self.begin(now);
        self.first.get_or_insert_with(|| cause.clone());
        self.newest = Some(cause.clone());
    }

    fn begin(&mut self, mark: Mark) {
        if self.since_us != mark.since_us() {
            let written = std::mem::take(&mut self.written);
            *self = Self { since_us: mark.since_us(), written, ..Self::default() };
        }
    }

    /// True while the fault of a raise is not written down.
    #[must_use]
    pub fn is_open(&self, slot: &str, at_ns: u64) -> bool {
        self.open.contains(&(slot, at_ns))
    }

    /// Faults were lost, and with them, perhaps, what raises were for.
    pub fn give_up(&mut self) {
        self.open.clear();
    }

    /// True where all raises of the latch, as it is, are written down, or an operator was told that they are not.
    #[must_use]
    pub fn are_told(&self, now: Mark) -> bool {
        let is_known = self.since_us == now.since_us() && self.heard >= now.raises() && self.open.is_empty();
        now.raises() == 0 || is_known || self.shown == Some(now)
    }

    /// An operator is told what is known of them.
    pub fn show(&mut self, now: Mark) {
        self.begin(now);
        self.shown = Some(now);
    }

    /// What the first of this run was for.
    #[must_use]
    pub const fn first(&self) -> Option<&Cause> {
        self.first.as_ref()
    }

    /// What the newest was for.
    #[must_use]
    pub const fn newest(&self) -> Option<&Cause> {
        self.newest.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SLOTS: [&str; 3] = ["one", "two", "three"];

    #[test]
    fn what_the_run_before_left_is_told() {
        assert!(Raises::default().are_told(Mark::left(5_000)));
        assert!(!Raises::default().are_told(Mark::left(5_000).again()));
        assert!(!Raises::default().are_told(Mark::new(5_000, 1)));
    }

    #[test]
    fn what_was_shown_is_told_until_it_is_raised_again() {
        let mut raises = Raises::default();
        raises.show(Mark::new(5_000, 1));
        assert!(raises.are_told(Mark::new(5_000, 1)) && !raises.are_told(Mark::new(5_000, 2)));
        raises.hear(Mark::new(9_000, 1), "one", 3);
        raises.record("one", 3, 1);
        raises.hear(Mark::new(5_000, 3), "two", 2);
        assert!(raises.are_told(Mark::new(9_000, 1)), "that of a latch before does not count");
    }

    proptest! {
        /// In whatever order raises and their faults are told, all are known with the last of them, and not before.
        #[test]
        fn all_are_told_with_the_last_word(count in 1_usize..8, dice in proptest::collection::vec(any::<usize>(), 16)) {
            let mut words: Vec<(usize, bool)> = (0..count).flat_map(|raise| [(raise, true), (raise, false)]).collect();
            let mut raises = Raises::default();
            let now = Mark::new(5_000, count as u64);
            for turn in dice {
                prop_assert_eq!(raises.are_told(now), words.is_empty());
                if words.is_empty() {
                    break;
                }
                let (raise, is_heard) = words.swap_remove(turn % words.len());
                let (slot, at_ns) = (SLOTS[raise % 3], raise as u64);
                if is_heard {
                    raises.hear(Mark::new(5_000, raise as u64 + 1), slot, at_ns);
                } else {
                    raises.record(slot, at_ns, 1);
                }
            }
        }
    }
}
