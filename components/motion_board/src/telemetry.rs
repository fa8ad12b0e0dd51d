//! Telemetry of the board as communication objects and log lines.

use board_protocol::{Encoders, StatusFlags, Ultrasonic};
use component_sdk::prelude::*;
use robot_objects::objects::stamp_of_micros;
use robot_objects::{EncoderCounts, UltrasonicRing};

use crate::link::BoardClock;

/// A reading of the encoders.
pub fn counts(reading: &Encoders, clock: &mut BoardClock) -> EncoderCounts {
    EncoderCounts { stamp: stamp_of_micros(clock.at(reading.time_us)), ticks: reading.ticks }
}

/// A round of the ultrasonic ring, millimetres to metres.
pub fn ring(round: &Ultrasonic, clock: &mut BoardClock) -> UltrasonicRing {
    let header = Header { stamp: stamp_of_micros(clock.at(round.time_us)), frame_id: "sonar".into() };
    UltrasonicRing { header, ranges: round.ranges_mm.map(|range| f32::from(range) / 1000.0) }
}

/// Logs what has changed about the board, in words.
pub fn tell_changes(cx: &Context<'_>, last: &mut StatusFlags, now: StatusFlags) {
    let begins = |flag: StatusFlags| now.contains(flag) && !last.contains(flag);
    let ends = |flag: StatusFlags| last.contains(flag) && !now.contains(flag);
    if begins(StatusFlags::EMERGENCY) {
        warn!(cx, "the board's emergency stop is latched");
    }
    if begins(StatusFlags::BUMPER) {
        warn!(cx, "the bumper touches something");
    }
    if ends(StatusFlags::LEFT_POWER) {
        warn!(cx, "the left motors have no power");
    }
    if ends(StatusFlags::RIGHT_POWER) {
        warn!(cx, "the right motors have no power");
    }
    *last = now;
}
