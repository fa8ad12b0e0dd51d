//! Obstacle avoidance by a potential field.

pub mod field;
pub mod steering;
