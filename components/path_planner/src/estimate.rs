//! Where the target is: sightings fused in the odometry's frame.
//!
//! Decision: one variance for both axes (a scalar Kalman gain) and a gate against outliers. Not chosen: a full two-dimensional
//! covariance; the robot drives along the line of sight, so the error across it is what counts and bearings are good anyway.

use robot_objects::angle;

/// A place and direction in the odometry's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Metres ahead of the start.
    pub x: f64,
    /// Metres to the left of the start.
    pub y: f64,
    /// Direction in rad.
    pub heading: f64,
}

/// Faster than this no robot of this kind moves (m/s) or turns (rad/s).
const TOP_SPEED: [f64; 2] = [2.0, 4.0];
/// Steps smaller than this say nothing about speed, in m and rad.
const SLACK: f64 = 0.1;

impl Pose {
    /// Whether nobody gets from here to `other` within `elapsed` s.
    #[must_use]
    pub fn is_beyond_reach_of(&self, other: &Self, elapsed: f64) -> bool {
        let [speed, turn] = TOP_SPEED.map(|top| SLACK + top * elapsed.max(0.0));
        (other.x - self.x).hypot(other.y - self.y) > speed || angle::wrap(other.heading - self.heading).abs() > turn
    }
}

/// An estimate of the target's place.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// In the odometry's frame, m.
    pub x: f64,
    /// In the odometry's frame, m.
    pub y: f64,
    /// Variance in m^2.
    variance: f64,
    /// Time of the last sighting in s; before any: none.
    pub last_seen: Option<f64>,
    /// Sightings in a row that were too far off.
    rejected: u8,
}

/// What the estimate loses between two sightings: odometry drifts. In m^2.
const DRIFT: f64 = 0.002;
/// Sightings in a row that contradict the estimate before it is given up.
const CONTRADICTIONS: u8 = 6;

impl Estimate {
    /// Somebody said that the target is about there (m).
    #[must_use]
    pub fn told(x: f64, y: f64) -> Self {
        Self { x, y, variance: 1.0, ..Self::default() }
    }

    /// The first sighting, `distance` m away at `bearing` rad from `pose`, at `now` s.
    #[must_use]
    pub fn first(pose: &Pose, bearing: f64, distance: f64, now: f64) -> Self {
        let (x, y) = place(pose, bearing, distance);
        Self { x, y, variance: noise(distance), last_seen: Some(now), rejected: 0 }
    }

    /// Takes one more sighting in.
    pub fn refine(&mut self, pose: &Pose, bearing: f64, distance: f64, now: f64) {
        let (x, y) = place(pose, bearing, distance);
        let (variance, noise) = (self.variance + DRIFT, noise(distance));
        let (dx, dy) = (x - self.x, y - self.y);
        if dx.hypot(dy) > 0.5 + 3.0 * (variance + noise).sqrt() {
            self.contradict(pose, bearing, distance, now);
            return;
        }
        let gain = variance / (variance + noise);
        self.x += gain * dx;
        self.y += gain * dy;
        self.variance = (1.0 - gain) * variance;
        (self.last_seen, self.rejected) = (Some(now), 0);
    }

    fn contradict(&mut self, pose: &Pose, bearing: f64, distance: f64, now: f64) {
        self.rejected += 1;
        if self.rejected >= CONTRADICTIONS {
            *self = Self::first(pose, bearing, distance, now);
        }
    }

    /// The same place seen from the robot, when the robot's pose `before` is called `after` from now on.
    #[must_use]
    pub fn carried(mut self, before: &Pose, after: &Pose) -> Self {
        (self.x, self.y) = place(after, self.bearing(before), self.distance(before));
        self
    }

    /// Distance from `pose` in m.
    #[must_use]
    pub fn distance(&self, pose: &Pose) -> f64 {
        (self.x - pose.x).hypot(self.y - pose.y)
    }

    /// Direction as seen from `pose`, in rad, not wrapped.
    #[must_use]
    pub fn bearing(&self, pose: &Pose) -> f64 {
        (self.y - pose.y).atan2(self.x - pose.x) - pose.heading
    }
}

/// Variance of a sighting: the distance is known to about a tenth.
fn noise(distance: f64) -> f64 {
    (0.05 + 0.1 * distance).powi(2)
}

fn place(pose: &Pose, bearing: f64, distance: f64) -> (f64, f64) {
    let direction = pose.heading + bearing;
    (pose.x + distance * direction.cos(), pose.y + distance * direction.sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sightings_from_many_places_meet_at_the_target() {
        let mut estimate = Estimate::told(5.0, 0.0);
        for step in 0..100 {
            let pose = Pose { x: f64::from(step) * 0.02, y: 0.0, heading: 0.3 };
            let (dx, dy) = (4.0 - pose.x, 1.0);
            let error = if step % 2 == 0 { 1.1 } else { 0.9 };
            estimate.refine(&pose, f64::atan2(dy, dx) - 0.3, f64::hypot(dx, dy) * error, f64::from(step));
        }
        assert!((estimate.x - 4.0).abs() < 0.15 && (estimate.y - 1.0).abs() < 0.1, "{estimate:?}");
    }

    #[test]
    fn one_ghost_is_ignored_and_a_moved_target_is_believed() {
        let pose = Pose::default();
        let mut estimate = Estimate::first(&pose, 0.0, 2.0, 0.0);
        estimate.refine(&pose, 2.0, 3.0, 0.1);
        assert!((estimate.x - 2.0).abs() < 0.01);
        for step in 0..10 {
            estimate.refine(&pose, 2.0, 3.0, 0.2 + f64::from(step));
        }
        assert!((estimate.bearing(&pose) - 2.0).abs() < 0.01);
    }
}
