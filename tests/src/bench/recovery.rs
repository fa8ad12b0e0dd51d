//! Recovery from provoked faults, through a real executor: from the faulting instruction to the first completed callback.
//!
//! The raw limit of a trap is a bare fiber that traps and another one that runs; of a panic, a bare `catch_unwind`.

use std::panic::catch_unwind;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use component_sdk::abi::inject;
use crossbeam_channel::Receiver;
use framework_daemon::model::fault::FaultEvent;
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::sys::fiber::{Ended, Fiber, NEVER};
use framework_daemon::sys::thread::SignalStack;
use framework_daemon::sys::trap;

use super::stats::Samples;
use crate::profiles::{Profiles, application, plugin_dir, slot};

const PATIENCE: Duration = Duration::from_secs(10);
const STACK: usize = 64 << 10;

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

/// `faults` faults of that symptom in a slot that is reset each time; returns its recoveries and the raw limit.
///
/// # Panics
/// When the system does not come up or a fault is not recovered.
#[must_use]
pub fn measure(symptom: &str, policy: &str, faults: usize) -> (Samples, Samples) {
    let rules = "<executor>main</executor><fault_tolerance><severity>reset</severity>\
                 <reset limit=\"1000\" within=\"1ms\"/></fault_tolerance>";
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", rules)], &[]));
    let priority = if policy == "fifo" { " policy=\"fifo\" priority=\"50\"" } else { "" };
    let executor = format!("<system_profile><name>b</name><executor name=\"main\"{priority}/></system_profile>");
    profiles.write("system.xml", &executor);
    let plan = load::load(profiles.path()).expect("the profile is valid").plan;
    let (sender, events) = crossbeam_channel::bounded(64);
    trap::install();
    let plugins: Vec<PathBuf> = vec![plugin_dir()];
    let system = boot(Arc::new(plan), &plugins, sender).expect("the system comes up");
    let placed = system.slot("ticker").expect("the slot is there").clone();
    let code = inject::code(symptom).expect("it can be provoked");
    let (mut own, mut limit) = (Samples::default(), Samples::default());
    let _stack = SignalStack::new();
    for _ in 0..faults {
        assert_eq!(placed.executor.inject(placed.member, code, PATIENCE), Ok(true));
        own.add(recovered(&events));
        limit.add(if symptom == "crash.panic" { bare_panic() } else { bare_trap() });
    }
    drop(placed);
    shutdown(system);
    (own, limit)
}

fn recovered(events: &Receiver<FaultEvent>) -> u64 {
    let event = events.recv_timeout(PATIENCE).expect("a fault event comes");
    event.times.first_callback_ns.expect("it is recovered")
}

/// A fiber that traps, another one that runs.
#[allow(unsafe_code, reason = "a fault on purpose")]
fn bare_trap() -> u64 {
    let mut first = Fiber::new(STACK).expect("address space");
    let mut second = Fiber::new(STACK).expect("address space");
    second.run(NEVER, &mut || {});
    let began = Instant::now();
    // SAFETY: none; the write faults, which is its purpose.
    let ended = first.run(NEVER, &mut || unsafe { std::hint::black_box(8 as *mut u32).write_volatile(1) });
    assert_eq!(ended, Ended::Trapped);
    second.run(NEVER, &mut || {});
    began.elapsed().as_nanos() as u64
}

fn bare_panic() -> u64 {
    let began = Instant::now();
    let caught = catch_unwind(|| panic!("bare"));
    let took = began.elapsed().as_nanos() as u64;
    assert!(caught.is_err());
    took
}
