//! Recovery from a callback that does not return: from its deadline to the first completed callback after it. The raw limit
//! is a bare watchdog, at the priority of ours, that signals a thread which spins. Both watchdogs are kept on one processor and
//! what they watch on another one: where they share one they take half as long, and which of them does is chance.

use std::time::Duration;

use framework_daemon::model::limits::PRIORITY_MAX;
use framework_daemon::sys::thread::spawn_guarded;
use framework_daemon::sys::watchdog;

use super::limits;
use super::rig::{self, Payload, Steps, profiles, schedule};
use super::stats::Samples;
use crate::profiles::plugin_dir;

/// What a callback may take.
const BUDGET: Duration = Duration::from_millis(1);
const DEADLINE: &str = "<deadline hang=\"1ms\">1ms</deadline></execution_semantics>";
/// Ours and the bare one.
const WATCHDOGS: [&str; 2] = ["watchdog", "bare-watchdog"];
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
    let bare = spawn_guarded("bare-watchdog", schedule("fifo", PRIORITY_MAX), |_| {}, limits::watchdog);
    watchdog::start().expect("a thread");
    for name in WATCHDOGS {
        // A thread takes its name when it begins to run.
        while !limits::keep_on(name, 1) {
            std::thread::yield_now();
        }
    }
    let measured = rig::measure(&profiles, policy, 0, faults, || limits::hang(BUDGET));
    limits::watch_end();
    let _ = bare.expect("a thread").join();
    measured
}
