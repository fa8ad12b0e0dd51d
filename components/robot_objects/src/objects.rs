//! The communication objects. Fields that ROS 2 has too bear its names; units are metres, radians, seconds.

use component_sdk::prelude::*;

use crate::motion::Motion;
use crate::ring::Ranges;

/// One round of the ultrasonic ring.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct UltrasonicRing {
    /// Board's time of measurement.
    pub header: Header,
    /// Distances in m from each transducer's face: 0 ahead, then counter-clockwise every 30 degrees. Within 0.03 to 3.0,
    /// which is also what one without echo says. Raw: 0 means that the sensor does not answer.
    pub ranges: Ranges,
}

/// How fast the wheels are to turn.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelCommand {
    /// Both left wheels, in rad/s, forward positive.
    pub left: f64,
    /// Both right wheels, in rad/s, forward positive.
    pub right: f64,
}

/// A reading of the wheel encoders.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderCounts {
    /// Board's time of measurement.
    pub stamp: Time,
    /// Ticks since the board started: front left, rear left, front right, rear right. They wrap around at 32 bits.
    pub ticks: [i32; 4],
}

/// What the detector has to say about one image.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct Detection {
    /// Camera's time of the image.
    pub stamp: Time,
    /// Whether the target is in it; if not, the rest is 0.
    pub found: bool,
    /// Direction from the robot's centre in rad, left positive.
    pub bearing: f64,
    /// Distance from the robot's centre to the target's in m, estimated.
    pub distance: f64,
    /// Share of the image that it fills, 0 to 1.
    pub area: f64,
}

impl From<Motion> for Twist {
    fn from(motion: Motion) -> Self {
        Self {
            linear: Vector3 { x: motion.forward, ..Vector3::default() },
            angular: Vector3 { z: motion.turn, ..Vector3::default() },
        }
    }
}

impl From<&Twist> for Motion {
    fn from(twist: &Twist) -> Self {
        Self { forward: twist.linear.x, turn: twist.angular.z }
    }
}

/// Microseconds of a device's clock as a time stamp.
#[must_use]
pub fn stamp_of_micros(micros: u64) -> Time {
    Time { sec: (micros / 1_000_000) as i32, nanosec: (micros % 1_000_000) as u32 * 1000 }
}

/// A time stamp in seconds, for differences.
#[must_use]
pub fn seconds(stamp: &Time) -> f64 {
    f64::from(stamp.sec) + f64::from(stamp.nanosec) * 1e-9
}
