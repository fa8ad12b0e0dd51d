//! `nav_msgs`.

use super::geometry::{PoseWithCovariance, TwistWithCovariance};
use super::sensor::Header;
use crate::CommObject;
use crate::object::Text;

/// Estimated position and velocity.
#[repr(C)]
#[derive(CommObject, Clone, Debug, Default, PartialEq)]
pub struct Odometry {
    /// Time, and the frame that the pose is in.
    pub header: Header,
    /// The frame that the velocity is in.
    pub child_frame_id: Text,
    /// Position and orientation.
    pub pose: PoseWithCovariance,
    /// Velocity.
    pub twist: TwistWithCovariance,
}
