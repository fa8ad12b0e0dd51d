//! `geometry_msgs`.

use crate::CommObject;

/// A vector in free space.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs, reason = "the axes")]
pub struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// A position, in metres.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
#[allow(missing_docs, reason = "the axes")]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// An orientation.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs, reason = "the components of a quaternion")]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Default for Quaternion {
    /// No rotation.
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

impl Quaternion {
    /// The rotation by `yaw` radians about the vertical axis.
    #[must_use]
    pub fn from_yaw(yaw: f64) -> Self {
        Self { x: 0.0, y: 0.0, z: (yaw / 2.0).sin(), w: (yaw / 2.0).cos() }
    }

    /// The angle about the vertical axis, -pi to pi.
    #[must_use]
    pub fn yaw(&self) -> f64 {
        let sine = 2.0 * (self.w * self.z + self.x * self.y);
        let cosine = 1.0 - 2.0 * (self.y * self.y + self.z * self.z);
        sine.atan2(cosine)
    }
}

/// Position and orientation.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Metres.
    pub position: Point,
    /// Unit quaternion.
    pub orientation: Quaternion,
}

/// Position and heading in the plane.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose2D {
    /// Metres.
    pub x: f64,
    /// Metres.
    pub y: f64,
    /// Radians, anticlockwise.
    pub theta: f64,
}

/// Velocity: metres and radians per second.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Metres per second.
    pub linear: Vector3,
    /// Radians per second.
    pub angular: Vector3,
}

/// A pose and how sure it is.
#[repr(C)]
#[derive(CommObject, Clone, Debug, PartialEq)]
pub struct PoseWithCovariance {
    /// The pose.
    pub pose: Pose,
    /// Row-major 6x6: x, y, z, rotations about x, y, z.
    pub covariance: [f64; 36],
}

impl Default for PoseWithCovariance {
    fn default() -> Self {
        Self { pose: Pose::default(), covariance: [0.0; 36] }
    }
}

/// A velocity and how sure it is.
#[repr(C)]
#[derive(CommObject, Clone, Debug, PartialEq)]
pub struct TwistWithCovariance {
    /// The velocity.
    pub twist: Twist,
    /// Row-major 6x6, as in [`PoseWithCovariance`].
    pub covariance: [f64; 36],
}

impl Default for TwistWithCovariance {
    fn default() -> Self {
        Self { twist: Twist::default(), covariance: [0.0; 36] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yaw_goes_there_and_back() {
        for yaw in [-3.0, -0.5, 0.0, 1.2, 3.1] {
            assert!((Quaternion::from_yaw(yaw).yaw() - yaw).abs() < 1e-12);
        }
    }
}
