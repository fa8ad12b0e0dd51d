//! Ultrasonic filter: raw ring in, ring without ghosts and dropouts out.

use component_sdk::prelude::*;
use robot_objects::UltrasonicRing;

pub mod ring_filter;

use ring_filter::{RingFilter, Settings};

/// Removes ghosts and dropouts from the ultrasonic ring.
#[derive(Component)]
#[component(name = "UltrasonicFilter", version = "1.0", nonperiodic)]
pub struct UltrasonicFilter {
    /// As the board sends it: the longest range where there was no echo, 0 where a sensor does not answer.
    #[port]
    raw: DataIn<UltrasonicRing>,
    /// Each distance within `min_range` and `max_range`.
    #[port]
    ranges: DataOut<UltrasonicRing>,
    /// Shortest distance that the sensor measures.
    #[property(default = 0.03, unit = "m", range = 0.0..=1.0)]
    min_range: f64,
    /// Longest distance that the sensor measures; also what a free direction reads.
    #[property(default = 3.0, unit = "m", range = 0.1..=10.0)]
    max_range: f64,
    /// Samples without echo, or answer, over which the last distance is held.
    #[property(default = 2, unit = "samples", range = 0..=50)]
    hold: u8,
    #[critical]
    filter: RingFilter,
}

impl Callbacks for UltrasonicFilter {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        let (min_range, max_range) = (self.min_range as f32, self.max_range as f32);
        if let Some(raw) = self.raw.fresh() {
            let ranges = self.filter.accept(&raw.ranges, &Settings { min_range, max_range, hold: self.hold });
            self.ranges.write(UltrasonicRing { header: raw.header.clone(), ranges });
        }
        Ok(())
    }
}

export_components!(UltrasonicFilter);
