//! Motor control: wanted motion in, wheel velocities out.

pub mod wheel_control;
