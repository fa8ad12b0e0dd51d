//! Obstacle avoidance by a polar histogram of free directions.

pub mod histogram;
pub mod steering;
