//! The field of forces: the course attracts, every echo repels.

use std::f64::consts::FRAC_PI_2;

use robot_objects::angle;
use robot_objects::ring::{self, Ranges};

/// A force in the robot's own axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Force {
    /// Forward part.
    pub x: f64,
    /// Part to the left.
    pub y: f64,
}

impl Force {
    /// A force of `strength` towards `bearing` (rad).
    #[must_use]
    pub fn towards(bearing: f64, strength: f64) -> Self {
        Self { x: strength * bearing.cos(), y: strength * bearing.sin() }
    }

    /// Both together.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y }
    }

    /// Where it pulls, in rad.
    #[must_use]
    pub fn bearing(self) -> f64 {
        self.y.atan2(self.x)
    }

    /// How strongly it pulls.
    #[must_use]
    pub fn strength(self) -> f64 {
        self.x.hypot(self.y)
    }
}

/// What all echoes together push: nothing beyond `reach`, as much as the course pulls at about half of it. `body` is the radius of
/// the robot; both in m from its centre. What stands in the way of `course` (rad) pushes to `side` (1 left, -1 right), too: a force
/// straight back would only stop the robot.
#[must_use]
pub fn repulsion(ranges: &Ranges, body: f64, reach: f64, course: f64, side: f64) -> Force {
    ring::echoes(ranges)
        .map(|(bearing, distance)| {
            let strength = push(distance - body, reach - body);
            let in_the_way = angle::wrap(bearing - course).cos().max(0.0);
            let aside = Force::towards(bearing + FRAC_PI_2, side * strength * in_the_way);
            Force::towards(bearing, -strength).plus(aside)
        })
        .fold(Force::default(), Force::plus)
}

/// Grows from 0 at `reach` without a jump, and fast when the gap closes.
fn push(gap: f64, reach: f64) -> f64 {
    if gap >= reach {
        return 0.0;
    }
    let gap = gap.max(0.02);
    0.35 * (reach / gap - 1.0).min(20.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_objects::ring::ECHOES;

    #[test]
    fn an_even_ring_pushes_nowhere() {
        assert!(repulsion(&[0.3; ECHOES], 0.25, 1.0, 0.0, 0.0).strength() < 1e-9);
    }

    #[test]
    fn a_wall_on_the_left_pushes_to_the_right() {
        let mut ranges = [3.0; ECHOES];
        ranges[3] = 0.3;
        let force = repulsion(&ranges, 0.25, 1.0, 0.0, 1.0);
        assert!(force.y < -0.3 && force.x.abs() < 1e-9);
    }

    #[test]
    fn nearer_pushes_harder() {
        assert!(push(0.1, 0.7) > 2.0 * push(0.3, 0.7));
        assert!(push(0.7, 0.7).abs() < 1e-12);
    }
}
