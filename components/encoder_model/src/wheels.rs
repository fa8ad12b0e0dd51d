//! What the wheels should do: each side follows its command with a lag.
//!
//! Decision: a first-order lag, the simplest that starts and stops as a driven wheel does. Not chosen: voltage, back-emf and friction
//! as in the simulator. A model that shares its plant's code agrees with it also where both are wrong.

use std::f64::consts::TAU;

use board_protocol::robot::TICKS_PER_REVOLUTION;

/// One side's wheels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Side {
    /// In rad/s.
    speed: f64,
    /// Way since the start, in rad.
    angle: f64,
}

impl Side {
    /// Exact for a command that stands still meanwhile, so that the step does not matter.
    fn advance(&mut self, wanted: f64, seconds: f64, lag: f64) {
        let rest = if lag > 0.0 { (-seconds / lag).exp() } else { 0.0 };
        self.angle += wanted * seconds + (self.speed - wanted) * lag * (1.0 - rest);
        self.speed = wanted + (self.speed - wanted) * rest;
    }

    fn ticks(&self) -> i32 {
        // Through i64, so that a long run wraps around as the board's counters do.
        (self.angle / TAU * f64::from(TICKS_PER_REVOLUTION)).floor() as i64 as i32
    }
}

/// The wheels as they should be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wheels {
    left: Side,
    right: Side,
}

impl Wheels {
    /// Goes on by `seconds` with these commands (rad/s), each followed with that lag (s). Commands that are no numbers count as
    /// standing still.
    pub fn advance(&mut self, [left, right]: [f64; 2], seconds: f64, lag: f64) {
        let sane = |wanted: f64| if wanted.is_finite() { wanted } else { 0.0 };
        self.left.advance(sane(left), seconds, lag);
        self.right.advance(sane(right), seconds, lag);
    }

    /// Encoder ticks since the start: front left, rear left, front right, rear right.
    #[must_use]
    pub fn ticks(&self) -> [i32; 4] {
        let (left, right) = (self.left.ticks(), self.right.ticks());
        [left, left, right, right]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_revolution_a_second_is_its_ticks_after_the_lag() {
        let mut wheels = Wheels::default();
        (0..500).for_each(|_| wheels.advance([TAU, -TAU], 0.002, 0.03));
        let [left, rear_left, right, _] = wheels.ticks();
        assert_eq!(left, rear_left);
        assert!((left - 1940).abs() <= 2 && (right + 1940).abs() <= 2, "{left} {right}");
    }

    #[test]
    fn the_step_does_not_matter() {
        let (mut fine, mut coarse) = (Wheels::default(), Wheels::default());
        (0..1000).for_each(|_| fine.advance([5.0, 3.0], 0.001, 0.05));
        (0..10).for_each(|_| coarse.advance([5.0, 3.0], 0.1, 0.05));
        assert!(fine.ticks().iter().zip(coarse.ticks()).all(|(one, other)| (one - other).abs() <= 1));
    }

    #[test]
    fn nonsense_stands_still_and_no_lag_is_no_division() {
        let mut wheels = Wheels::default();
        wheels.advance([f64::NAN, f64::INFINITY], 1.0, 0.03);
        assert_eq!(wheels.ticks(), [0; 4]);
        wheels.advance([TAU, TAU], 1.0, 0.0);
        assert!(wheels.ticks().iter().all(|ticks| (1999..=2001).contains(ticks)));
    }
}
