//! `builtin_interfaces`, `std_msgs`, `sensor_msgs`.

use super::geometry::{Quaternion, Vector3};
use crate::CommObject;
use crate::context::Instant;
use crate::object::{Sequence, Text};

/// A moment.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Time {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds, below 1e9.
    pub nanosec: u32,
}

impl From<Instant> for Time {
    fn from(instant: Instant) -> Self {
        let nanos = instant.as_nanos();
        Self { sec: (nanos / 1_000_000_000) as i32, nanosec: (nanos % 1_000_000_000) as u32 }
    }
}

/// When and in which frame.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// When it was measured.
    pub stamp: Time,
    /// Frame of reference.
    pub frame_id: Text,
}

/// One distance.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Range {
    /// When and where.
    pub header: Header,
    /// 0: ultrasound, 1: infrared.
    pub radiation_type: u8,
    /// Radians.
    pub field_of_view: f32,
    /// Metres.
    pub min_range: f32,
    /// Metres.
    pub max_range: f32,
    /// Metres.
    pub range: f32,
    /// Square metres.
    pub variance: f32,
}

/// Distances in a plane.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct LaserScan {
    /// Time of the first ray.
    pub header: Header,
    /// Radians.
    pub angle_min: f32,
    /// Radians.
    pub angle_max: f32,
    /// Radians.
    pub angle_increment: f32,
    /// Seconds between rays.
    pub time_increment: f32,
    /// Seconds between scans.
    pub scan_time: f32,
    /// Metres.
    pub range_min: f32,
    /// Metres.
    pub range_max: f32,
    /// Metres.
    pub ranges: Sequence<f32>,
    /// In the device's own unit.
    pub intensities: Sequence<f32>,
}

/// A picture.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Image {
    /// When and where.
    pub header: Header,
    /// Rows.
    pub height: u32,
    /// Columns.
    pub width: u32,
    /// `rgb8`, `mono8`, ...
    pub encoding: Text,
    /// 1: numbers of several bytes are big-endian.
    pub is_bigendian: u8,
    /// Bytes in a row.
    pub step: u32,
    /// Rows, one after the other: `step * height` bytes.
    pub data: Sequence<u8>,
}

/// Orientation, angular velocity and acceleration.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Imu {
    /// When and where.
    pub header: Header,
    /// Unit quaternion.
    pub orientation: Quaternion,
    /// Row-major 3x3; first element -1: no orientation.
    pub orientation_covariance: [f64; 9],
    /// Radians per second.
    pub angular_velocity: Vector3,
    /// Row-major 3x3.
    pub angular_velocity_covariance: [f64; 9],
    /// Metres per second squared.
    pub linear_acceleration: Vector3,
    /// Row-major 3x3.
    pub linear_acceleration_covariance: [f64; 9],
}

/// The state of joints.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct JointState {
    /// When.
    pub header: Header,
    /// One name a joint.
    pub name: Sequence<Text>,
    /// Radians or metres.
    pub position: Sequence<f64>,
    /// Radians or metres per second.
    pub velocity: Sequence<f64>,
    /// Newton metres or newtons.
    pub effort: Sequence<f64>,
}
