//! Recovery from a callback that does not return: from its deadline to the first completed callback after it. The raw limit
//! is a bare watchdog, at the priority of ours, that signals a thread which spins.

use std::time::Duration;

use framework_daemon::model::limits::PRIORITY_MAX;
use framework_daemon::sys::thread::spawn_guarded;

use super::limits;
use super::rig::{self, Payload, Steps, profiles, schedule};
use super::stats::Samples;
use crate::profiles::plugin_dir;

/// What a callback may take.
const BUDGET: Duration = Duration::from_millis(1);
const DEADLINE: &str = "<deadline hang=\"1ms\">1ms</deadline></execution_semantics>";
const AFTER: &str = "<properties><property name=\"after\" type=\"int\">1</property></properties>";

/// `faults` endless loops in a slot that is reset each time; returns its recoveries and the raw limit.
///
/// # Panics
/// When the slot does not come up or a fault is not recovered.
#[must_use]
pub fn measure(payload: Payload, policy: &str, faults: usize) -> (Steps, Samples) {
    let profiles = profiles("InfiniteLoop", AFTER, payload);
    profiles.describe(&plugin_dir().join("libtorture.so"));
    profiles.replace("InfiniteLoop.xml", "</execution_semantics>", DEADLINE);
    limits::watch_prepare();
    // Ours is at real-time priority whatever the executors' policy is, where that is permitted.
    let watchdog = spawn_guarded("bare-watchdog", schedule("fifo", PRIORITY_MAX), |_| {}, limits::watchdog);
    let measured = rig::measure(&profiles, policy, 0, faults, || limits::hang(BUDGET));
    limits::watch_end();
    let _ = watchdog.expect("a thread").join();
    measured
}
