//! The paper's experiment behind its figure 10: the power of the left wheels fails while the robot drives, and the front left
//! encoder is compared with its reference model, filtered over windows of several lengths.
//!
//! Each window is a run of its own: the daemon with `profiles/encoder_monitor`, on the simulated board. What encoder and model
//! wrote is recorded at their ports (`port echo`), the moment of the failure is the simulator's, the moment of detection the
//! journal's. Only the filtered difference is not told by the daemon from value to value; it is computed from the recorded samples
//! with the daemon's own comparison, and what that says at the moment of detection is what the journal's evidence says.

mod drive;
mod stage;

use framework_daemon::detect::model_diff::{Change, Comparison, Demand, Measure, Reading, Side};

pub use drive::measure;
pub use stage::{Failure, Programs};

/// Lengths of the window, in ms.
pub const WINDOWS_MS: [u64; 5] = [100, 200, 400, 700, 1000];
/// When the power fails, in s after the first command to drive.
pub const POWER_OFF: f64 = 1.0;
/// How long is recorded after that, in s.
pub const AFTER: f64 = 1.2;

/// Of the encoders.
const FRONT_LEFT: usize = 0;

/// What a port passed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// When it was written, in monotonic nanoseconds: what the comparison goes by.
    pub at_ns: u64,
    /// When it was measured, by the clock of whoever did, in s.
    pub measured: f64,
    /// What the front left encoder counted.
    pub ticks: i32,
}

/// The journal's entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// When the fault was raised, in monotonic nanoseconds.
    pub at_ns: u64,
    /// The filtered rate of the encoder then, in ticks/s.
    pub target: f64,
    /// The model's.
    pub model: f64,
    /// By how much they differed.
    pub difference: f64,
    /// By how much they may, as the profile says.
    pub threshold: f64,
}

/// A run of the daemon with a window of that length.
#[derive(Clone, Debug)]
pub struct Run {
    /// The window's length in ms.
    pub window_ms: u64,
    /// When the power failed, in monotonic nanoseconds.
    pub power_off_ns: u64,
    /// What the board's encoder counted.
    pub encoder: Vec<Sample>,
    /// What it should have.
    pub model: Vec<Sample>,
    /// The fault.
    pub found: Found,
}

/// What a comparison said when a value came.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Compared {
    /// When the value came, in monotonic nanoseconds.
    pub at_ns: u64,
    /// What it said.
    pub reading: Reading,
}

impl Run {
    /// Seconds since the first command to drive.
    #[must_use]
    pub fn seconds(&self, at_ns: u64) -> f64 {
        (at_ns as f64 - self.power_off_ns as f64) / 1e9 + POWER_OFF
    }

    /// How long it took to find that the power had failed, in ms.
    #[must_use]
    pub fn found_after_ms(&self) -> f64 {
        (self.seconds(self.found.at_ns) - POWER_OFF) * 1e3
    }

    /// What was recorded, compared as the daemon did.
    #[must_use]
    pub fn compared(&self) -> Vec<Compared> {
        let window_ns = self.window_ms * 1_000_000;
        let mut comparison =
            Comparison::new(Demand { window_ns, threshold: self.found.threshold, measure: Measure::Rate });
        let mut all: Vec<(Side, Sample)> = self.encoder.iter().map(|sample| (Side::Target, *sample)).collect();
        all.extend(self.model.iter().map(|sample| (Side::Model, *sample)));
        all.sort_by_key(|(_, sample)| sample.at_ns);
        let note = |(side, Sample { at_ns, ticks, .. })| {
            Some(Compared { at_ns, reading: comparison.note(side, f64::from(ticks), at_ns)? })
        };
        all.into_iter().filter_map(note).collect()
    }

    /// Where the recorded signals part for the first time after the power failed.
    #[must_use]
    pub fn parted(&self) -> Option<Compared> {
        let parted = |one: &Compared| one.at_ns >= self.power_off_ns && one.reading.change == Some(Change::Parted);
        self.compared().into_iter().find(parted)
    }
}

/// What a counter counts in a second, from one sample to the next: seconds of the run, ticks/s.
#[must_use]
pub fn rates(run: &Run, samples: &[Sample]) -> Vec<(f64, f64)> {
    let rate = |pair: &[Sample]| {
        let [before, now] = pair else { return None };
        let elapsed = now.measured - before.measured;
        (elapsed > 0.0).then(|| (run.seconds(now.at_ns), f64::from(now.ticks.wrapping_sub(before.ticks)) / elapsed))
    };
    samples.windows(2).filter_map(rate).collect()
}
