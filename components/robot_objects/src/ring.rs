//! The ring of ultrasonic echoes: twelve directions, number 0 ahead, then counter-clockwise every 30 degrees.

use std::f64::consts::{FRAC_PI_2, TAU};

use board_protocol::robot;

use crate::angle;

/// How many directions the ring listens in.
pub const ECHOES: usize = 12;

/// Angle between two neighbouring directions, in rad.
pub const STEP: f64 = TAU / ECHOES as f64;

/// Distance of the transducers from the robot's centre, in m.
pub const RADIUS: f64 = robot::RING_RADIUS_M as f64;

/// Distances in m from each transducer's face, by direction; the sensor's longest range where there was no echo. A raw ring has 0
/// where a sensor does not answer; a filtered one never has.
pub type Ranges = [f32; ECHOES];

/// The direction of echo `index` in rad, left positive, in `-PI..=PI`.
#[must_use]
pub fn bearing(index: usize) -> f64 {
    angle::wrap(STEP * f64::from(u8::try_from(index % ECHOES).unwrap_or(0)))
}

/// The echo whose direction is nearest to `bearing` (rad).
#[must_use]
pub fn nearest_index(bearing: f64) -> usize {
    (0..ECHOES).min_by(|a, b| distance_to(*a, bearing).total_cmp(&distance_to(*b, bearing))).unwrap_or(0)
}

fn distance_to(index: usize, towards: f64) -> f64 {
    angle::wrap(bearing(index) - towards).abs()
}

/// Every echo as (bearing in rad, distance from the robot's centre in m). What is no number counts as touching.
pub fn echoes(ranges: &Ranges) -> impl Iterator<Item = (f64, f64)> + '_ {
    ranges.iter().enumerate().map(|(index, range)| (bearing(index), f64::from(*range).max(0.0) + RADIUS))
}

/// The nearest echo within `half_angle` (rad) of `towards` (rad), in m from the centre; infinite when there is none.
#[must_use]
pub fn nearest_within(ranges: &Ranges, towards: f64, half_angle: f64) -> f64 {
    echoes(ranges)
        .filter(|(bearing, _)| angle::wrap(bearing - towards).abs() <= half_angle)
        .map(|(_, distance)| distance)
        .fold(f64::INFINITY, f64::min)
}

/// How far the robot can go in the direction `towards` (rad) before something of the ring enters the lane of
/// `half_width` m on either side; in m, from the robot's centre; infinite when the lane is free.
#[must_use]
pub fn free_along(ranges: &Ranges, towards: f64, half_width: f64) -> f64 {
    echoes(ranges)
        .map(|(bearing, distance)| (angle::wrap(bearing - towards), distance))
        .filter(|(off, distance)| off.abs() < FRAC_PI_2 - 0.01 && (distance * off.sin()).abs() < half_width)
        .map(|(off, distance)| distance * off.cos())
        .fold(f64::INFINITY, f64::min)
}

/// [`free_along`] the robot's own direction.
#[must_use]
pub fn free_ahead(ranges: &Ranges, half_width: f64) -> f64 {
    free_along(ranges, 0.0, half_width)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn echoes_count_counter_clockwise_from_ahead() {
        assert!(bearing(0).abs() < 1e-12);
        assert!((bearing(3) - FRAC_PI_2).abs() < 1e-12);
        assert!((bearing(9) + FRAC_PI_2).abs() < 1e-12);
        assert_eq!(nearest_index(-0.5), 11);
    }

    #[test]
    fn a_side_wall_is_not_in_the_lane() {
        let mut ranges = [3.0; ECHOES];
        ranges[2] = 0.6;
        assert!(free_ahead(&ranges, 0.3) >= 3.0);
        ranges[1] = 0.3;
        assert!((free_ahead(&ranges, 0.3) - 0.433).abs() < 1e-3);
    }
}
