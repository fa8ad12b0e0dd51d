//! The standard set. Names of types and fields are those of ROS 2's own messages (`geometry_msgs`, `sensor_msgs`,
//! `nav_msgs`, `std_msgs`, `builtin_interfaces`), units as there: metres, radians, seconds. Those of faults are the fault
//! manager's own.

mod fault;
mod geometry;
mod navigation;
mod sensor;

pub use fault::{FaultFilter, FaultNotice, FaultReport};
pub use geometry::{Point, Pose, Pose2D, PoseWithCovariance, Quaternion, Twist, TwistWithCovariance, Vector3};
pub use navigation::Odometry;
pub use sensor::{Header, Image, Imu, JointState, LaserScan, Range, Time};
