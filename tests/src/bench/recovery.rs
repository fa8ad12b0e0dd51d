//! Recovery from provoked faults, through a real executor: from the faulting instruction to the first completed callback.
//! After each fault the raw limit is measured on a thread that is scheduled like the executor.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use component_sdk::abi::inject;
use crossbeam_channel::Receiver;
use framework_daemon::model::fault::FaultEvent;
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::sys::trap;

use super::limits;
use super::stats::Samples;
use super::yardstick::{Yardstick, schedule};
use crate::profiles::{Profiles, application, plugin_dir, slot};

const PATIENCE: Duration = Duration::from_secs(10);
/// Priority of executor and yardstick under `fifo`.
pub const PRIORITY: i32 = 50;

/// Threads that spin: all cores busy.
pub struct Load(Arc<AtomicBool>);

impl Load {
    /// Starts `threads` of them.
    #[must_use]
    pub fn start(threads: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        for _ in 0..threads {
            let stop = Arc::clone(&stop);
            thread::spawn(move || {
                while !stop.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        Self(stop)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// What takes the place of the instance that failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// One that is made at the moment of the fault; the same one after a panic.
    Fresh,
    /// One that was made before, of the same class.
    Spare,
}

impl Payload {
    /// `fresh instance`, `spare`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fresh => "fresh instance",
            Self::Spare => "spare",
        }
    }

    const fn rule(self) -> &'static str {
        match self {
            Self::Fresh => "",
            Self::Spare => "<spare count=\"4\" preload=\"instance\"/>",
        }
    }
}

/// `faults` faults of that symptom in a slot that is reset each time; returns its recoveries and the raw limit.
///
/// # Panics
/// When the system does not come up or a fault is not recovered.
#[must_use]
pub fn measure(symptom: &str, payload: Payload, policy: &str, faults: usize) -> (Samples, Samples) {
    let profiles = profiles(payload, policy);
    let plan = load::load(profiles.path()).expect("the profile is valid").plan;
    let (sender, events) = crossbeam_channel::bounded(64);
    trap::install();
    let plugins: Vec<PathBuf> = vec![plugin_dir()];
    let system = boot(Arc::new(plan), &plugins, sender).expect("the system comes up");
    let placed = system.slot("ticker").expect("the slot is there").clone();
    let code = inject::code(symptom).expect("it can be provoked");
    let limit = if symptom == "crash.panic" { limits::panic } else { limits::trap };
    let yardstick = Yardstick::start(schedule(policy, PRIORITY), limit);
    let (mut own, mut raw) = (Samples::default(), Samples::default());
    for _ in 0..faults {
        assert_eq!(placed.executor.inject(placed.member, code, PATIENCE), Ok(true));
        own.add(recovered(&events));
        raw.add(yardstick.measure());
    }
    drop(placed);
    shutdown(system);
    (own, raw)
}

fn profiles(payload: Payload, policy: &str) -> Profiles {
    let rules = format!(
        "<executor>main</executor><fault_tolerance><severity>reset</severity>\
         <reset limit=\"1000\" within=\"1ms\"/>{}</fault_tolerance>",
        payload.rule()
    );
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", &rules)], &[]));
    profiles.replace("Ticker.xml", "<period>2ms</period>", "<period>500us</period>");
    let priority = if policy == "fifo" { format!(" policy=\"fifo\" priority=\"{PRIORITY}\"") } else { String::new() };
    profiles.write(
        "system.xml",
        &format!("<system_profile><name>b</name><executor name=\"main\"{priority}/></system_profile>"),
    );
    profiles
}

fn recovered(events: &Receiver<FaultEvent>) -> u64 {
    let event = events.recv_timeout(PATIENCE).expect("a fault event comes");
    event.times.first_callback_ns.expect("it is recovered")
}
