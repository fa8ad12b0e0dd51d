//! From the trap to the queued event the executor's thread neither allocates nor frees: the allocator of this test counts.
#![allow(unsafe_code, reason = "a counting allocator")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use component_sdk::abi::inject;
use crossbeam_channel::Receiver;
use framework_daemon::model::fault::{FaultEvent, Outcome};
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::sys::{clock, trap};
use tests::profiles::{Profiles, application, plugin_dir, slot};

const PATIENCE: Duration = Duration::from_secs(20);
const FAULTS: usize = 50;
const NOTES: usize = 256;

/// Notes when the watched thread used the allocator while no event was queued.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

static EVENTS: OnceLock<Receiver<FaultEvent>> = OnceLock::new();
static WATCHED: AtomicI32 = AtomicI32::new(0);
static WATCHING: AtomicBool = AtomicBool::new(false);
static NOTED: AtomicUsize = AtomicUsize::new(0);
static TIMES: [AtomicU64; NOTES] = [const { AtomicU64::new(0) }; NOTES];

fn note() {
    // SAFETY: a system call without arguments.
    let is_watched = WATCHING.load(Ordering::Relaxed) && unsafe { libc::gettid() } == WATCHED.load(Ordering::Relaxed);
    if is_watched && EVENTS.get().is_some_and(Receiver::is_empty) {
        let place = NOTED.fetch_add(1, Ordering::Relaxed);
        TIMES[place % NOTES].store(clock::now_ns(), Ordering::Relaxed);
    }
}

// SAFETY: everything is the system's allocator; noting touches no memory of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: the caller's own promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        note();
        // SAFETY: the caller's own promise.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Number of the thread of that name.
fn thread_number(name: &str) -> i32 {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap().map(Result::unwrap);
    let named = |path: &PathBuf| std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name);
    let found = tasks.map(|task| task.path()).find(named).expect("the executor's thread bears its name");
    found.file_name().unwrap().to_str().unwrap().parse().unwrap()
}

/// The next event, left in the queue until it was seen there, so that nothing after it is noted.
fn event(events: &Receiver<FaultEvent>) -> FaultEvent {
    let began = Instant::now();
    while events.is_empty() {
        assert!(began.elapsed() < PATIENCE, "a fault event comes");
        std::thread::sleep(Duration::from_millis(1));
    }
    WATCHING.store(false, Ordering::Relaxed);
    events.recv().unwrap()
}

fn recover_again_and_again(rules: &str, symptom: &str) {
    let inside =
        format!("<executor>watched</executor><fault_tolerance><severity>reset</severity>{rules}</fault_tolerance>");
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", &inside)], &[]));
    profiles.write("system.xml", "<system_profile><name>a</name><executor name=\"watched\"/></system_profile>");
    let plan = load::load(profiles.path()).unwrap().plan;
    let (sender, events) = crossbeam_channel::bounded(64);
    let events = EVENTS.get_or_init(|| events.clone()).clone();
    trap::install();
    let system = boot(Arc::new(plan), &[plugin_dir()], sender).unwrap();
    WATCHED.store(thread_number("watched"), Ordering::Relaxed);
    let placed = system.slot("ticker").unwrap().clone();
    let code = inject::code(symptom).unwrap();
    for number in 0..FAULTS {
        system.workshop.settle(PATIENCE);
        NOTED.store(0, Ordering::Relaxed);
        WATCHING.store(true, Ordering::Relaxed);
        assert_eq!(placed.executor.inject(placed.member, code, PATIENCE), Ok(true));
        let event = event(&events);
        assert_eq!(event.outcome, Outcome::Recovered, "{symptom}");
        let noted = NOTED.load(Ordering::Relaxed).min(NOTES);
        let times = TIMES[..noted].iter().map(|time| time.load(Ordering::Relaxed));
        let after: Vec<u64> = times.filter_map(|time| time.checked_sub(event.fault.at_ns)).collect();
        let first = event.times.first_callback_ns;
        assert!(
            after.is_empty(),
            "fault {number} ({symptom}): used {after:?} ns after it, first callback at {first:?}"
        );
    }
    drop(placed);
    shutdown(system);
}

#[test]
fn a_recovery_by_a_spare_uses_no_allocator() {
    recover_again_and_again("<reset limit=\"1000\" within=\"1s\"/><spare count=\"2\"/>", "crash.segv");
}
