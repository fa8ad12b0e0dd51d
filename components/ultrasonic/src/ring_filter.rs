//! Median of three and hold over dropouts, for each direction on its own.
//!
//! Decision: a median of three removes the single wild echo (cross-talk, a specular ghost) at the price of one sample of delay.
//! Not chosen: a low-pass; it smears one ghost over many samples and is late exactly when an obstacle comes near.

use robot_objects::ring::{ECHOES, Ranges};

/// What the transducers can do, and how patient the filter is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Shortest distance that the sensor measures, in m.
    pub min_range: f32,
    /// Longest distance that the sensor measures, in m; also what a free direction reads.
    pub max_range: f32,
    /// Samples without echo over which the last distance is held, 0 to 255.
    pub hold: u8,
}

impl Default for Settings {
    fn default() -> Self {
        Self { min_range: 0.03, max_range: 3.0, hold: 2 }
    }
}

/// Filter state of the whole ring.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RingFilter {
    directions: [Direction; ECHOES],
}

impl RingFilter {
    /// Takes one raw ring (`max_range` or beyond: no echo; 0: no answer) and gives the filtered one, each value in `min_range..=max_range`.
    pub fn accept(&mut self, raw: &Ranges, settings: &Settings) -> Ranges {
        let mut filtered = [settings.max_range; ECHOES];
        for ((direction, echo), out) in self.directions.iter_mut().zip(raw).zip(&mut filtered) {
            *out = direction.accept(*echo, settings);
        }
        filtered
    }
}

/// Filter state of one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Direction {
    /// The last values, newest first; the first `known` count.
    recent: [f32; 3],
    known: u8,
    silent: u8,
}

impl Direction {
    fn accept(&mut self, echo: f32, settings: &Settings) -> f32 {
        let value = self.bridge(echo, settings);
        self.recent = [value, self.recent[0], self.recent[1]];
        self.known = self.known.saturating_add(1).min(3);
        // Two values have no middle: the nearer one is the safer.
        match self.known {
            1 => value,
            2 => self.recent[0].min(self.recent[1]),
            _ => median(self.recent),
        }
    }

    /// The echo, or what stands in for a missing one: the last value for a while, then "free".
    fn bridge(&mut self, echo: f32, settings: &Settings) -> f32 {
        // A NaN compares false, so it counts as missing too.
        if echo >= settings.min_range && echo < settings.max_range {
            self.silent = 0;
            return echo;
        }
        self.silent = self.silent.saturating_add(1);
        if self.known > 0 && self.silent <= settings.hold { self.recent[0] } else { settings.max_range }
    }
}

fn median([a, b, c]: [f32; 3]) -> f32 {
    a.min(b).max(a.max(b).min(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feed(filter: &mut RingFilter, values: &[f32]) -> Vec<f32> {
        values.iter().map(|value| filter.accept(&[*value; ECHOES], &Settings::default())[4]).collect()
    }

    #[test]
    fn a_single_ghost_disappears() {
        assert_eq!(feed(&mut RingFilter::default(), &[2.0, 2.0, 0.3, 2.0, 2.0]), [2.0; 5]);
    }

    #[test]
    fn a_real_step_passes_after_one_sample() {
        assert_eq!(feed(&mut RingFilter::default(), &[2.0, 2.0, 0.5, 0.5]), [2.0, 2.0, 2.0, 0.5]);
    }

    #[test]
    fn a_dropout_is_held_and_then_free() {
        for nothing in [3.0, 0.0] {
            let out = feed(&mut RingFilter::default(), &[1.0, 1.0, nothing, nothing, nothing, nothing]);
            assert_eq!(out, [1.0, 1.0, 1.0, 1.0, 1.0, 3.0]);
        }
    }

    #[test]
    fn nonsense_never_leaves_the_range() {
        let values = [f32::NAN, -1.0, f32::INFINITY, 1e9, 0.001, f32::NEG_INFINITY];
        for value in feed(&mut RingFilter::default(), &values) {
            assert!((0.03..=3.0).contains(&value), "{value}");
        }
    }
}
