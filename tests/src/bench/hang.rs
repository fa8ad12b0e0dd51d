//! Recovery from a callback that does not return: from its deadline to the first completed callback after it. The raw limit
//! is a bare watchdog, at the priority of ours, that signals a thread which spins.

use std::time::Duration;

use framework_daemon::model::limits::PRIORITY_MAX;
use framework_daemon::sys::thread::spawn_guarded;

use super::limits;
use super::stats::Samples;
use super::system::{OneSlot, PRIORITY, Payload, Steps, profiles};
use super::yardstick::{Yardstick, schedule};
use crate::profiles::plugin_dir;

/// What a callback may take.
const BUDGET: Duration = Duration::from_millis(1);
const DEADLINE: &str = "<deadline hang=\"1ms\">1ms</deadline></execution_semantics>";
/// Good cycles between two hangs: time for the limit, alone.
const AFTER: &str = "<properties><property name=\"after\" type=\"int\">5</property></properties>";

/// `faults` endless loops in a slot that is reset each time; returns its recoveries and the raw limit.
///
/// # Panics
/// When the system does not come up or a fault is not recovered.
#[must_use]
pub fn measure(payload: Payload, policy: &str, faults: usize) -> (Steps, Samples) {
    let profiles = profiles("InfiniteLoop", AFTER, payload, policy);
    profiles.describe(&plugin_dir().join("libtorture.so"));
    profiles.replace("InfiniteLoop.xml", "<period>1ms</period>", "<period>500us</period>");
    profiles.replace("InfiniteLoop.xml", "</execution_semantics>", DEADLINE);
    limits::watch_prepare();
    // Ours is at real-time priority whatever the executors' policy is, where that is permitted.
    let watchdog = spawn_guarded("bare-watchdog", schedule("fifo", PRIORITY_MAX), |_| {}, limits::watchdog);
    let yardstick = Yardstick::start(schedule(policy, PRIORITY), || limits::hang(BUDGET));
    let system = OneSlot::boot(&profiles);
    let (mut own, mut raw) = (Steps::default(), Samples::default());
    for _ in 0..faults {
        system.recovered(&mut own);
        raw.add(yardstick.measure());
    }
    system.shutdown();
    drop(yardstick);
    limits::watch_end();
    let _ = watchdog.expect("a thread").join();
    (own, raw)
}
