//! path_planner
