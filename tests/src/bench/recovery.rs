//! Recovery from provoked faults, through a real executor: from the faulting instruction to the first completed callback.
//! After each fault the raw limit is measured on a thread that is scheduled like the executor.

use component_sdk::abi::inject;

use super::limits;
use super::stats::Samples;
use super::system::{OneSlot, PATIENCE, PRIORITY, Payload, Steps, profiles};
use super::yardstick::{Yardstick, schedule};

/// `faults` faults of that symptom in a slot that is reset each time; returns its recoveries and the raw limit.
///
/// # Panics
/// When the system does not come up or a fault is not recovered.
#[must_use]
pub fn measure(symptom: &str, payload: Payload, policy: &str, faults: usize) -> (Steps, Samples) {
    let profiles = profiles("Downer", "", payload, policy);
    profiles.replace("Downer.xml", "<period>2ms</period>", "<period>500us</period>");
    let system = OneSlot::boot(&profiles);
    let subject = system.subject();
    let code = inject::code(symptom).expect("it can be provoked");
    let limit = if symptom == "crash.panic" { limits::panic } else { limits::trap };
    let yardstick = Yardstick::start(schedule(policy, PRIORITY), limit);
    let (mut own, mut raw) = (Steps::default(), Samples::default());
    for _ in 0..faults {
        assert_eq!(subject.executor.inject(subject.member, code, PATIENCE), Ok(true));
        system.recovered(&mut own);
        raw.add(yardstick.measure());
    }
    drop(subject);
    system.shutdown();
    (own, raw)
}
