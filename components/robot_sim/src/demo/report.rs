//! What a run left behind, and whether it was a success.

use super::journal::Fault;
use super::schedule::Injection;
use crate::serve::record::{End, Moment};
use crate::world::World;

/// A fault due this shortly before the end may not have happened yet, in seconds.
const DUE_MARGIN_S: f64 = 1.0;

/// Everything that a table and a picture need.
#[derive(Debug, Clone)]
pub struct Report {
    /// Where the robot drove.
    pub world: World,
    /// Its path.
    pub track: Vec<Moment>,
    /// How the simulator says it ended; `None` when it did not come to an end.
    pub end: Option<End>,
    /// What failed, in the order of time.
    pub faults: Vec<Fault>,
    /// Who drove from when on, where a skill changes it: nanoseconds of the monotonic clock, and a name.
    pub steered: Vec<(u64, String)>,
    /// What was to fail.
    pub schedule: Vec<Injection>,
    /// When the daemon was ready, nanoseconds of the monotonic clock. All times for people count from here.
    pub ready_ns: u64,
    /// When the demo stopped looking, same clock.
    pub over_ns: u64,
    /// What else went wrong, for people.
    pub complaints: Vec<String>,
}

impl Report {
    /// Seconds from ready to `mono_ns`.
    #[must_use]
    pub fn seconds(&self, mono_ns: u64) -> f64 {
        (mono_ns as f64 - self.ready_ns as f64) / 1e9
    }

    /// Whether the robot came to its target.
    #[must_use]
    pub fn reached(&self) -> bool {
        self.end.is_some_and(|end| end.reached)
    }

    /// Seconds from ready to arrival, or to the moment the demo gave up.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.seconds(self.end.map_or(self.over_ns, |end| end.mono_ns))
    }

    /// Faults that called for recovery.
    #[must_use]
    pub fn fault_count(&self) -> usize {
        self.faults.iter().filter(|fault| !fault.ignored()).count()
    }

    /// Faults after which the component worked again.
    #[must_use]
    pub fn recovered_count(&self) -> usize {
        self.faults.iter().filter(|fault| fault.recovered()).count()
    }

    /// How often the robot bumped into something.
    #[must_use]
    pub fn collisions(&self) -> u32 {
        self.end.map(|end| end.collisions).or(self.track.last().map(|moment| moment.collisions)).unwrap_or(0)
    }

    /// Faults that were due before the end and are not in the journal.
    #[must_use]
    pub fn unseen(&self) -> Vec<&Injection> {
        let mut seen: Vec<_> = self.faults.iter().filter(|fault| fault.injected).collect();
        let due = self.schedule.iter().filter(|injection| injection.at + DUE_MARGIN_S < self.duration());
        due.filter(|injection| {
            let found =
                seen.iter().position(|fault| fault.slot == injection.slot && fault.symptom == injection.symptom);
            found.map(|index| seen.swap_remove(index)).is_none()
        })
        .collect()
    }

    /// Where the robot was at `mono_ns`, between the recorded moments.
    #[must_use]
    pub fn place(&self, mono_ns: u64) -> Option<Moment> {
        let after = self.track.partition_point(|moment| moment.mono_ns < mono_ns);
        self.track.get(after).or(self.track.last()).copied()
    }

    /// Whether the robot arrived, every fault was recovered from, every due fault was seen, and nothing was hit.
    #[must_use]
    pub fn success(&self) -> bool {
        let all_recovered = self.recovered_count() == self.fault_count();
        self.reached() && all_recovered && self.unseen().is_empty() && self.collisions() == 0
    }

    /// The last line of a demo.
    #[must_use]
    pub fn last_line(&self) -> String {
        summary(self.reached(), self.duration(), self.fault_count(), self.recovered_count(), self.collisions())
    }
}

/// `target reached in T s; faults F, recovered R, collisions C`.
#[must_use]
pub fn summary(reached: bool, seconds: f64, faults: usize, recovered: usize, collisions: u32) -> String {
    let how = if reached { "target reached in" } else { "target not reached after" };
    format!("{how} {seconds:.1} s; faults {faults}, recovered {recovered}, collisions {collisions}")
}
