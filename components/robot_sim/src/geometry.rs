//! Places and directions in the world's plane: metres, radians, counter-clockwise, x to the right, y up.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

/// A place in the plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Metres to the right.
    pub x: f64,
    /// Metres up.
    pub y: f64,
}

impl Point {
    /// The place `distance` metres away in the direction `angle` (radians).
    #[must_use]
    pub fn towards(self, angle: f64, distance: f64) -> Self {
        Self { x: self.x + distance * angle.cos(), y: self.y + distance * angle.sin() }
    }

    /// Distance to `other`, in metres.
    #[must_use]
    pub fn distance(self, other: Self) -> f64 {
        (other.x - self.x).hypot(other.y - self.y)
    }

    /// Direction from here to `other`, in radians.
    #[must_use]
    pub fn bearing(self, other: Self) -> f64 {
        (other.y - self.y).atan2(other.x - self.x)
    }
}

/// Where something is and which way it looks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// The place of its centre.
    pub at: Point,
    /// Direction it looks, radians from the x axis.
    pub theta: f64,
}

/// The same direction within -π to π.
#[must_use]
pub fn wrap(angle: f64) -> f64 {
    let turn = (angle + PI).rem_euclid(2.0 * PI);
    turn - PI
}
