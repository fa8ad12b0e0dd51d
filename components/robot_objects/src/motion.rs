//! Motion in the plane, and what a *course* means.

use crate::angle;

/// Time within which a course wants to be on its bearing, in seconds: it makes `turn` of a course and its bearing one
/// number.
pub const COURSE_HORIZON: f64 = 1.0;

/// Speed along and about the robot's own axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Forward speed in m/s.
    pub forward: f64,
    /// Turn rate in rad/s, left positive.
    pub turn: f64,
}

impl Motion {
    /// Standing still.
    pub const STOP: Self = Self { forward: 0.0, turn: 0.0 };

    /// A course: go `speed` m/s in the direction `bearing` (rad, left positive). It is a wish, not a command: `forward`
    /// is the speed once the robot points there, and whoever turns a course into a command slows down for turns and
    /// obstacles.
    #[must_use]
    pub fn course(speed: f64, bearing: f64) -> Self {
        Self { forward: speed, turn: angle::wrap(bearing) / COURSE_HORIZON }
    }

    /// The motion itself, or standing still where it is no finite number: nobody may drive on nonsense.
    #[must_use]
    pub fn or_stop(self) -> Self {
        if self.forward.is_finite() && self.turn.is_finite() { self } else { Self::STOP }
    }

    /// The bearing that a course asks for, in `-PI..=PI`.
    #[must_use]
    pub fn bearing(self) -> f64 {
        angle::wrap(self.turn * COURSE_HORIZON)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_course_keeps_its_bearing() {
        assert!((Motion::course(0.4, -2.5).bearing() + 2.5).abs() < 1e-12);
    }
}
