//! The robot runtime that does not go down.
//!
//! A module may use only modules to its left (`tests/tests/tidy.rs` keeps it so):
//!
//! `model -> sys -> detect -> profile -> plugin -> port -> exec -> runtime -> fault -> supervise -> daemon -> cli -> main`
//!
//! - **Data path**: `port::write -> port::check -> port::connection -> port::read -> exec::executor -> exec::callback`
//! - **Fault path**: `detect (symptom) -> model::FaultEvent -> exec::recover (answer on the spot) -> fault (journal, next standby)`

/// Plain data that everybody may use: names, symptoms, lifecycle, limits. Knows nobody.
pub mod model;

/// XML text to a checked [`profile::plan::Plan`]. Knows no threads and no plugins.
pub mod profile;

/// One file per verb of the command line.
pub mod cli;
