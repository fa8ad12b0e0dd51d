//! Reverse order, a deadline for each component: one that does not return is named and left behind.

use super::helpers::Helpers;
use super::monitors::Monitors;
use super::system::{Placed, System};
use crate::model::limits::SHUTDOWN_STEP as STEP;
use crate::sys::log_ring;

/// Ends a system: all are stopped first, last started first, then all are destroyed.
pub fn shutdown(mut system: System) {
    // From now on silence is meant.
    system.follow(Monitors::default(), &Helpers::default());
    let last_first: Vec<Placed> = system.slots.iter().rev().cloned().collect();
    for placed in &last_first {
        if placed.executor.stop_member(placed.member, STEP).is_err() {
            tracing::error!("slot {}: `stop` did not return within {STEP:?}: left behind", placed.slot.name);
        }
    }
    for placed in &last_first {
        if placed.executor.remove(placed.member, STEP).is_err() {
            tracing::error!("slot {}: `destroy` did not return within {STEP:?}: left behind", placed.slot.name);
        }
    }
    drop(last_first);
    drop(system);
    log_ring::flush(STEP);
}
