//! From the trap to the queued event the executor's thread neither allocates nor frees: the allocator of this test counts.
#![allow(unsafe_code, reason = "a counting allocator")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicPtr, AtomicU64, AtomicUsize, Ordering};
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

const NOTES: usize = 256;

/// Notes when the watched thread used the allocator while no event was queued.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Where the events of the present system arrive; leaked, because the allocator looks at it at any time.
static EVENTS: AtomicPtr<Receiver<FaultEvent>> = AtomicPtr::new(std::ptr::null_mut());
static WATCHED: AtomicI32 = AtomicI32::new(0);
static WATCHING: AtomicBool = AtomicBool::new(false);
static NOTED: AtomicUsize = AtomicUsize::new(0);
static TIMES: [AtomicU64; NOTES] = [const { AtomicU64::new(0) }; NOTES];

fn note() {
    // SAFETY: a system call without arguments.
    let is_watched = WATCHING.load(Ordering::Relaxed) && unsafe { libc::gettid() } == WATCHED.load(Ordering::Relaxed);
    // SAFETY: null or leaked.
    let is_before = is_watched && unsafe { EVENTS.load(Ordering::Acquire).as_ref() }.is_some_and(Receiver::is_empty);
    // Asked again: the queue is empty once more when the event was taken.
    if is_before && WATCHING.load(Ordering::SeqCst) {
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
    WATCHING.store(false, Ordering::SeqCst);
    events.recv().unwrap()
}

/// Provokes these faults, one after the other, in a slot with these rules.
fn recover_from<'a>(symptoms: impl Iterator<Item = &'a str>, rules: &str) {
    let inside =
        format!("<executor>watched</executor><fault_tolerance><severity>reset</severity>{rules}</fault_tolerance>");
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", &inside)], &[]));
    profiles.executors(&["watched"]);
    let plan = load::load(profiles.path()).unwrap().plan;
    let (sender, events) = crossbeam_channel::bounded(64);
    EVENTS.store(Box::into_raw(Box::new(events.clone())), Ordering::Release);
    trap::install();
    let system = boot(Arc::new(plan), &[plugin_dir()], sender).unwrap();
    let placed = system.slot("ticker").unwrap().clone();
    for symptom in symptoms {
        assert!(system.workshop.settle(PATIENCE));
        WATCHED.store(thread_number("watched"), Ordering::Relaxed);
        NOTED.store(0, Ordering::Relaxed);
        WATCHING.store(true, Ordering::Relaxed);
        let code = inject::code(symptom).unwrap();
        assert_eq!(placed.executor.inject(placed.member, code, PATIENCE), Ok(true));
        let event = event(&events);
        assert_eq!(event.outcome, Outcome::Recovered, "{symptom}");
        let noted = NOTED.load(Ordering::Relaxed).min(NOTES);
        let times = TIMES[..noted].iter().map(|time| time.load(Ordering::Relaxed));
        let after: Vec<u64> = times.filter_map(|time| time.checked_sub(event.fault.at_ns)).collect();
        let first = event.times.first_callback_ns;
        assert!(after.is_empty(), "{symptom}: used {after:?} ns after it, first callback at {first:?}");
    }
    drop(placed);
    shutdown(system);
}

// One test, because one thread is watched at a time.
#[test]
fn a_recovery_by_reset_spare_or_secondary_uses_no_allocator() {
    let symptoms = ["crash.segv", "crash.panic", "crash.fpe", "error", "crash.ill", "crash.stack", "crash.segv"];
    recover_from(symptoms.into_iter().cycle().take(50), "<reset limit=\"1000\" within=\"1s\"/><spare count=\"2\"/>");
    let secondaries = "<secondary reference=\"Downer.xml\"/>".repeat(16);
    let rules = format!("<reset limit=\"0\"/>{secondaries}<checkpoint period=\"1ms\"/>");
    recover_from(std::iter::repeat_n("crash.segv", 16), &rules);
}
