//! Angles in radians, left (counter-clockwise) positive.

use std::f64::consts::{PI, TAU};

/// The same direction within `-PI..=PI`.
#[must_use]
pub fn wrap(angle: f64) -> f64 {
    if angle.is_finite() { angle - TAU * (angle / TAU).round() } else { 0.0 }
}

/// `angle` plus the number of full turns that brings it nearest to `previous`: a direction followed without jumps.
#[must_use]
pub fn unwrap(angle: f64, previous: f64) -> f64 {
    previous + wrap(angle - previous)
}

/// Degrees to radians, for constants that people read.
#[must_use]
pub const fn degrees(value: f64) -> f64 {
    value * PI / 180.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_keeps_the_direction() {
        assert!((wrap(3.0 * PI / 2.0) + PI / 2.0).abs() < 1e-12);
        assert!((wrap(-20.0 * TAU + 0.25) - 0.25).abs() < 1e-9);
        assert!(wrap(f64::NAN).abs() < 1e-12);
    }

    #[test]
    fn unwrapping_counts_turns() {
        let mut followed = 0.0;
        for step in 0..100 {
            followed = unwrap(wrap(f64::from(step) * 0.2), followed);
        }
        assert!((followed - 19.8).abs() < 1e-9);
    }
}
