//! A further ultrasonic ring, on a board and a line of its own, redundant to the motion board's: it hears the same world with noise
//! of its own. It may fall silent, and it may drift.

use std::time::Duration;

use board_protocol::Ultrasonic;
use board_protocol::robot::MIN_RANGE_MM;

use crate::geometry::Pose;
use crate::noise::Noise;
use crate::scene::Scene;
use crate::sonar;

/// How fast the ranges of a ring that drifts shrink, in millimetres per second.
pub const DRIFT_MM_PER_S: u64 = 200;

/// What goes wrong with a ring, each so long after the first command to drive; `None`: never.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SonarFaults {
    /// It says nothing any more.
    pub silent_after: Option<Duration>,
    /// Whatever it measures seems nearer and nearer, by [`DRIFT_MM_PER_S`].
    pub drifts_after: Option<Duration>,
}

/// A ring with its board.
pub(crate) struct SonarUnit {
    faults: SonarFaults,
    noise: Noise,
}

impl SonarUnit {
    pub(crate) fn new(faults: SonarFaults, noise: Noise) -> Self {
        Self { faults, noise }
    }

    /// What it says that long after the first command to drive (`None`: there was none yet); `None`: nothing.
    pub(crate) fn round(
        &mut self,
        scene: &Scene,
        pose: Pose,
        time_us: u32,
        driven: Option<Duration>,
    ) -> Option<Ultrasonic> {
        let over = |after: Option<Duration>| driven?.checked_sub(after?);
        let ranges_mm = sonar::ring(scene, pose, &mut self.noise);
        if over(self.faults.silent_after).is_some() {
            return None;
        }
        let drift = over(self.faults.drifts_after).unwrap_or_default().as_millis() as u64 * DRIFT_MM_PER_S / 1000;
        let drift = u16::try_from(drift).unwrap_or(u16::MAX);
        Some(Ultrasonic { time_us, ranges_mm: ranges_mm.map(|range| range.saturating_sub(drift).max(MIN_RANGE_MM)) })
    }
}
