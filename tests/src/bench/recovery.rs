//! Recovery from provoked faults: from the faulting instruction to the first completed callback.

use component_sdk::abi::inject;

use super::limits;
use super::rig::{self, Payload, Steps, profiles};
use super::stats::Samples;

/// `faults` faults of that symptom in a slot that is reset each time; returns its recoveries and the raw limit.
///
/// # Panics
/// When the slot does not come up or a fault is not recovered.
#[must_use]
pub fn measure(symptom: &str, payload: Payload, policy: &str, faults: usize) -> (Steps, Samples) {
    let code = inject::code(symptom).expect("it can be provoked");
    let limit = if symptom == "crash.panic" { limits::panic } else { limits::trap };
    rig::measure(&profiles("Beat", "", payload), policy, code, faults, limit)
}
