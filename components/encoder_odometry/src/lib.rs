//! Encoder odometry: ticks in, position and speed out.

pub mod odometer;
