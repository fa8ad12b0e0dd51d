//! Polar histogram: which of 72 directions the robot's body fits through.

use std::f64::consts::{FRAC_PI_2, TAU};

use robot_objects::angle;
use robot_objects::ring::{self, Ranges};

/// Directions of the histogram, five degrees each.
pub const SECTORS: usize = 72;

/// Half of what one transducer's beam covers that its neighbours do not, in rad: an echo may come from anywhere in there.
pub const HALF_BEAM: f64 = 0.12;

/// For each direction, whether an echo nearer than the horizon stands in the way of the body.
#[derive(Clone, Debug)]
pub struct Histogram {
    blocked: [bool; SECTORS],
}

impl Histogram {
    /// Blocks around each echo nearer than `horizon` the directions in which a disc of radius `body` would hit it. Both in m from
    /// the robot's centre. `blur` (rad) is how much farther off than its direction each echo may be, see [`HALF_BEAM`].
    #[must_use]
    pub fn of(ranges: &Ranges, body: f64, blur: f64, horizon: f64) -> Self {
        let mut histogram = Self { blocked: [false; SECTORS] };
        for (bearing, distance) in ring::echoes(ranges).filter(|(_, distance)| *distance < horizon) {
            histogram.block(bearing, shadow(body, distance) + blur);
        }
        histogram
    }

    fn block(&mut self, centre: f64, half_width: f64) {
        for (sector, blocked) in self.blocked.iter_mut().enumerate() {
            *blocked |= angle::wrap(direction_of(sector) - centre).abs() <= half_width;
        }
    }

    /// Whether the robot fits through in the direction `bearing` (rad).
    #[must_use]
    pub fn is_free(&self, bearing: f64) -> bool {
        !self.blocked[sector_of(bearing)]
    }

    /// The first free direction met when turning from `from` towards the `sign` side (left positive), at most `reach` away (rad);
    /// relative to `from`'s own number of turns.
    #[must_use]
    pub fn first_free(&self, from: f64, sign: f64, reach: f64) -> Option<f64> {
        let width = TAU / SECTORS as f64;
        let steps = (reach / width) as usize;
        (0..=steps).map(|step| from + sign * width * step as f64).find(|bearing| self.is_free(*bearing))
    }
}

/// Half of the angle that an obstacle at `distance` hides for a disc of radius `body`.
fn shadow(body: f64, distance: f64) -> f64 {
    if distance > body { (body / distance).asin() } else { FRAC_PI_2 }
}

fn direction_of(sector: usize) -> f64 {
    angle::wrap(TAU * sector as f64 / SECTORS as f64)
}

fn sector_of(bearing: f64) -> usize {
    let turns = (angle::wrap(bearing) / TAU).rem_euclid(1.0);
    (turns * SECTORS as f64).round() as usize % SECTORS
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_objects::ring::ECHOES;

    #[test]
    fn an_empty_ring_blocks_nothing() {
        let histogram = Histogram::of(&[3.0; ECHOES], 0.3, HALF_BEAM, 1.0);
        assert!((0..SECTORS).all(|sector| histogram.is_free(direction_of(sector))));
    }

    #[test]
    fn an_obstacle_ahead_leaves_the_sides() {
        let mut ranges = [3.0; ECHOES];
        ranges[0] = 0.4;
        let histogram = Histogram::of(&ranges, 0.3, HALF_BEAM, 1.0);
        assert!(!histogram.is_free(0.0) && !histogram.is_free(-0.4));
        assert!(histogram.is_free(1.0) && histogram.is_free(-1.0));
        let left = histogram.first_free(0.0, 1.0, 3.0);
        assert!(left.is_some_and(|bearing| (0.5..0.9).contains(&bearing)), "{left:?}");
    }

    #[test]
    fn every_direction_has_its_sector() {
        assert!((0..SECTORS).all(|sector| sector_of(direction_of(sector)) == sector));
    }
}
