//! One root for a chain of symptoms: which symptoms may be a consequence of what failed upstream, and for how long their own
//! answer waits. Pure.
//!
//! OPRoS knows severities and dependencies, and nothing of chains; the patents of its authors find the components that a fault
//! affects along the dependency relation, and plan one recovery for all of them. Here the slot upstream that failed first is
//! the root, and its answer is the answer. A follower is written down as a consequence and is not reset for garbage that it
//! was fed, or for a silence that it only handed on. What is still wrong when `CONSEQUENCE_WINDOW` is over is a fault of its
//! own.
//!
//! What may wait is what comes of inputs and leaves the instance sound: a bad value, silence, a vote or a comparison that is
//! lost, an error that is returned, a late return, a queue that overflows. Never:
//! - a trap, a hang, an exit: the instance may not be entered again, so the slot is empty until it is recovered;
//! - a panic: what the instance holds may be changed by half;
//! - a lost device, a wiring that does not fit, a missed recovery: no input causes those;
//! - what somebody raised: it is said once, and nobody says when it is over;
//! - whatever leads to the emergency stop: an actuator may be driven by the garbage meanwhile.
//!
//! A root is a fault that its own rules answer. One that they ignore heals nobody, so whoever it reaches answers for himself.
//! And it counts from the moment in which it was seen, not from that in which its executor takes it up: the consequence may be
//! quicker. A voter hides its members: one that is outvoted excuses no reader, because the others are handed on; only while
//! too few agree ([`Lapse`](crate::model::chain::Lapse)) a reader's fault is looked for beyond it. Tried and left: marking the followers when the root fails; the recovery would pay for each of them.

use super::limits::CONSEQUENCE_WINDOW;
use super::symptom::{Severity, SeverityTable, Symptom};
use super::time::nanoseconds;

/// True where a symptom may come of what the slot was fed, and leaves the instance sound.
#[must_use]
pub const fn may_follow(symptom: Symptom) -> bool {
    match symptom {
        Symptom::Error
        | Symptom::Overrun
        | Symptom::Validity
        | Symptom::Rate
        | Symptom::Stale
        | Symptom::Model
        | Symptom::Vote
        | Symptom::Overload => true,
        Symptom::CrashPanic
        | Symptom::CrashSegv
        | Symptom::CrashBus
        | Symptom::CrashFpe
        | Symptom::CrashIll
        | Symptom::CrashAbort
        | Symptom::CrashStack
        | Symptom::CrashExit
        | Symptom::Hang
        | Symptom::Type
        | Symptom::Raised
        | Symptom::Device
        | Symptom::Late => false,
    }
}

/// True of a symptom by which a voter may lose the slot's vote: it is silent from then on, or what it says is wrong. A callback
/// that is late, a queue that overflows or a wiring that does not fit costs no vote, nor does what somebody tells of.
#[must_use]
pub const fn costs_vote(symptom: Symptom) -> bool {
    match symptom {
        Symptom::CrashPanic
        | Symptom::CrashSegv
        | Symptom::CrashBus
        | Symptom::CrashFpe
        | Symptom::CrashIll
        | Symptom::CrashAbort
        | Symptom::CrashStack
        | Symptom::CrashExit
        | Symptom::Error
        | Symptom::Hang
        | Symptom::Validity
        | Symptom::Rate
        | Symptom::Stale
        | Symptom::Model
        | Symptom::Vote
        | Symptom::Device => true,
        Symptom::Overrun | Symptom::Type | Symptom::Raised | Symptom::Late | Symptom::Overload => false,
    }
}

/// True where the answer to a symptom may wait for that of its root; `reaches_all`: a stop of the slot is an emergency.
#[must_use]
pub const fn may_wait(symptom: Symptom, severity: Severity, reaches_all: bool) -> bool {
    let waits = match severity {
        Severity::Reset => true,
        Severity::Stop => !reaches_all,
        // Nothing is done, or it is done at once.
        Severity::Ignore | Severity::Emergency => false,
    };
    waits && may_follow(symptom)
}

/// Of which symptoms a slot can be a root: those that it answers, one bit each.
#[must_use]
pub fn answered(rules: &SeverityTable) -> u32 {
    let is_answered = |symptom: &Symptom| rules.get(*symptom) != Severity::Ignore || symptom.loses_instance();
    Symptom::ALL.into_iter().filter(is_answered).fold(0, |bits, symptom| bits | bit(symptom))
}

/// The bit of a symptom in [`answered`].
#[must_use]
pub const fn bit(symptom: Symptom) -> u32 {
    1 << symptom as u32
}

const _: () = assert!(Symptom::COUNT <= u32::BITS as usize, "a bit for each symptom");

/// Since when, and until when, a slot is a root: times of its own faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mark {
    /// The first one that was answered, of those that follow one another within the window; 0: there was none.
    pub first_ns: u64,
    /// The last one of those.
    pub last_ns: u64,
    /// The first one that was seen, by whomever, and that its executor has not taken up yet; 0: there is none.
    pub seen_ns: u64,
}

impl Mark {
    /// It was never one.
    pub const NONE: Self = Self { first_ns: 0, last_ns: 0, seen_ns: 0 };

    /// After a fault of that time was seen. An earlier one that nobody has taken up counts: what comes afterwards may be the
    /// same time of bad values.
    #[must_use]
    pub fn seen(self, at_ns: u64) -> Self {
        let is_pending = self.seen_ns <= at_ns && reaches(self.seen_ns, at_ns);
        Self { seen_ns: if is_pending { self.seen_ns } else { at_ns }, ..self }
    }

    /// Since when a fault of the slot shows that is told of with that time: it may have been seen before.
    #[must_use]
    pub fn onset_ns(self, at_ns: u64) -> u64 {
        if reaches(self.seen_ns, at_ns) { self.seen_ns.min(at_ns) } else { at_ns }
    }

    /// After a fault of the slot that began at `onset_ns` is answered.
    #[must_use]
    pub fn taken_up(self, onset_ns: u64) -> Self {
        let goes_on = self.first_ns <= onset_ns && reaches(self.last_ns, onset_ns);
        let first_ns = if goes_on { self.first_ns } else { onset_ns };
        Self { first_ns, last_ns: self.last_ns.max(onset_ns), seen_ns: 0 }
    }

    /// After a fault of the slot is left to another one's.
    #[must_use]
    pub const fn left(self) -> Self {
        Self { seen_ns: 0, ..self }
    }

    /// Until when it is the root of what began at `onset_ns` further down; `None`: it is not. What began at the same time, or
    /// earlier, is no consequence: of two slots that feed each other only one can be the other's root.
    #[must_use]
    pub fn root_until_ns(self, onset_ns: u64) -> Option<u64> {
        let runs = [(self.first_ns, self.last_ns), (self.seen_ns, self.seen_ns)];
        let is_root = |(first_ns, last_ns): &(u64, u64)| *first_ns < onset_ns && reaches(*last_ns, onset_ns);
        runs.into_iter().filter(is_root).map(|(_, last_ns)| until_ns(last_ns)).max()
    }
}

/// A time in which a voter had nothing to hand on, because too few of its members agreed: whatever its readers lack comes of
/// what the members have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lapse {
    /// When it began; 0: there was none.
    pub since_ns: u64,
    /// When it ended; [`u64::MAX`]: it lasts.
    pub until_ns: u64,
}

impl Lapse {
    /// After too few agree, from then on. One that follows another within the window is the same.
    #[must_use]
    pub fn begun(self, now_ns: u64) -> Self {
        let goes_on = self.reaches(now_ns);
        Self { since_ns: if goes_on { self.since_ns } else { now_ns }, until_ns: u64::MAX }
    }

    /// After enough agree again.
    #[must_use]
    pub const fn ended(self, now_ns: u64) -> Self {
        Self { until_ns: now_ns, ..self }
    }

    /// True where what began then at one of its readers may come of it.
    #[must_use]
    pub fn reaches(self, onset_ns: u64) -> bool {
        self.since_ns != 0 && self.since_ns <= onset_ns && onset_ns <= until_ns(self.until_ns)
    }
}

fn reaches(root_ns: u64, at_ns: u64) -> bool {
    root_ns != 0 && at_ns <= until_ns(root_ns)
}

fn until_ns(root_ns: u64) -> u64 {
    root_ns.saturating_add(nanoseconds(CONSEQUENCE_WINDOW))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const WINDOW: u64 = CONSEQUENCE_WINDOW.as_nanos() as u64;

    #[test]
    fn what_loses_the_instance_or_leads_to_the_emergency_stop_never_waits() {
        for symptom in Symptom::ALL {
            assert!(!(symptom.loses_instance() && may_follow(symptom)), "{symptom:?}");
            assert!(!may_wait(symptom, Severity::Emergency, false) && !may_wait(symptom, Severity::Ignore, false));
            assert!(!may_wait(symptom, Severity::Stop, true));
        }
        assert!(may_wait(Symptom::Validity, Severity::Reset, true) && may_wait(Symptom::Error, Severity::Stop, false));
        assert!(!may_follow(Symptom::CrashPanic));
    }

    #[test]
    fn what_loses_the_instance_costs_its_vote() {
        assert!(Symptom::ALL.into_iter().all(|symptom| !symptom.loses_instance() || costs_vote(symptom)));
        assert!(!costs_vote(Symptom::Overrun));
    }

    #[test]
    fn only_what_is_answered_makes_a_root() {
        let mut rules = SeverityTable::opros_default();
        rules.set(Symptom::CrashSegv, Severity::Ignore);
        let bits = answered(&rules);
        assert_eq!((bits & bit(Symptom::Validity), bits & bit(Symptom::Error)), (0, bit(Symptom::Error)));
        assert_ne!(bits & bit(Symptom::CrashSegv), 0, "an empty slot is filled, or stops");
    }

    #[test]
    fn one_that_was_seen_early_and_taken_up_late_began_early() {
        let seen = Mark::NONE.seen(100).seen(150);
        assert_eq!((seen.onset_ns(170), seen.onset_ns(100 + WINDOW + 1)), (100, 100 + WINDOW + 1));
        assert_eq!(seen.root_until_ns(120), Some(100 + WINDOW));
        assert_eq!(seen.root_until_ns(100), None, "at the same time");
        assert_eq!(seen.root_until_ns(101 + WINDOW), None, "too late");
        let answered = seen.taken_up(seen.onset_ns(170));
        assert_eq!((answered.onset_ns(200), answered.root_until_ns(120)), (200, Some(100 + WINDOW)));
        assert_eq!(seen.left(), Mark::NONE);
        assert_eq!(Mark::NONE.root_until_ns(5), None);
    }

    #[test]
    fn one_that_fails_again_and_again_is_the_root_since_the_first_time() {
        let twice = Mark::NONE.taken_up(100).taken_up(300);
        assert_eq!((twice.root_until_ns(200), twice.root_until_ns(100)), (Some(300 + WINDOW), None));
        let later = twice.taken_up(301 + WINDOW);
        assert_eq!((later.first_ns, later.root_until_ns(200)), (301 + WINDOW, None));
    }

    #[test]
    fn what_a_reader_lacks_comes_of_a_lapse_while_it_lasts_and_a_window_after() {
        let lapse = Lapse::default().begun(100);
        assert!(!Lapse::default().reaches(100) && !lapse.reaches(99));
        assert!(lapse.reaches(100) && lapse.reaches(10 * WINDOW));
        let over = lapse.ended(200);
        assert!(over.reaches(200 + WINDOW) && !over.reaches(201 + WINDOW));
        assert_eq!((over.begun(300).since_ns, over.begun(201 + WINDOW).since_ns), (100, 201 + WINDOW));
    }

    proptest! {
        /// Of slots that feed each other in a ring one at least answers, however late each takes up what was seen.
        #[test]
        fn somebody_answers(seen in prop::collection::vec(1..2 * WINDOW, 1..6), delays in prop::collection::vec(0..WINDOW, 6), order in Just((0..6usize).collect::<Vec<_>>()).prop_shuffle()) {
            let mut marks: Vec<Mark> = seen.iter().map(|at| Mark::NONE.seen(*at)).collect();
            let (mut answers, count) = (0, marks.len());
            for slot in order.into_iter().filter(|slot| *slot < count) {
                let onset = marks[slot].onset_ns(seen[slot] + delays[slot]);
                let root = marks.iter().enumerate().any(|(other, mark)| other != slot && mark.root_until_ns(onset).is_some());
                marks[slot] = if root { marks[slot].left() } else { marks[slot].taken_up(onset) };
                answers += usize::from(!root);
            }
            prop_assert!(answers > 0);
        }
    }
}
