//! Path planner.

pub mod estimate;
pub mod planner;
