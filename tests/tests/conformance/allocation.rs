//! Queries, messages, methods and events use no allocator of the daemon once they run: this test's allocator counts.
#![allow(unsafe_code, reason = "a counting allocator")]

use std::alloc::{GlobalAlloc, Layout};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::supervise::system::System;
use framework_daemon::sys::trap;
use tests::profiles::{Profiles, plugin_dir};

use crate::rig::Transport;
use crate::{event, query, send};

struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

static WATCHED: [AtomicI32; 2] = [AtomicI32::new(0), AtomicI32::new(0)];
static WATCHING: AtomicBool = AtomicBool::new(false);
static NOTED: AtomicU64 = AtomicU64::new(0);

fn note() {
    if WATCHING.load(Ordering::Relaxed) {
        // SAFETY: a system call without arguments.
        let own = unsafe { libc::gettid() };
        NOTED.fetch_add(
            u64::from(WATCHED.iter().any(|watched| watched.load(Ordering::Relaxed) == own)),
            Ordering::Relaxed,
        );
    }
}

// SAFETY: everything is the system's allocator; noting touches no memory of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note();
        // SAFETY: the caller's own promise.
        unsafe { std::alloc::System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        note();
        // SAFETY: the caller's own promise.
        unsafe { std::alloc::System.dealloc(memory, layout) }
    }
}

/// Number of the thread of that name, if there is one.
fn thread_number(name: &str) -> Option<i32> {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap().map(Result::unwrap);
    let named =
        |path: &std::path::PathBuf| std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name);
    tasks.map(|task| task.path()).find(named)?.file_name()?.to_str()?.parse().ok()
}

/// Counts the allocations of two executors while a slot's port carries that much more; the count of what failed stays as it is.
fn measure(profiles: &Profiles, executors: [&str; 2], more: u64, counts: impl Fn(&System) -> (u64, u64)) {
    let plan = load::load(profiles.path()).unwrap().plan;
    let (sender, _events) = crossbeam_channel::bounded(64);
    trap::install();
    let system = boot(Arc::new(plan), &[plugin_dir()], sender).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    for (watched, name) in WATCHED.iter().zip(executors) {
        watched.store(thread_number(name).expect("the executor's thread bears its name"), Ordering::Relaxed);
    }
    let before = counts(&system);
    NOTED.store(0, Ordering::SeqCst);
    WATCHING.store(true, Ordering::SeqCst);
    let began = Instant::now();
    while counts(&system).0 < before.0 + more {
        assert!(began.elapsed() < PATIENCE, "{:?} after {before:?}", counts(&system));
        std::thread::sleep(Duration::from_millis(10));
    }
    WATCHING.store(false, Ordering::SeqCst);
    assert_eq!((NOTED.load(Ordering::SeqCst), counts(&system).1), (0, before.1), "allocations and what failed");
    shutdown(system);
}

const PATIENCE: Duration = Duration::from_secs(120);
const SIDES: [(Transport, [&str; 2]); 2] = [(Transport::Near, ["main", "main"]), (Transport::Far, ["left", "right"])];

// One test, because few threads are watched at a time.
#[test]
fn queries_messages_methods_and_events_use_no_allocator_near_or_far() {
    let calls = |slot: &'static str, port: &'static str| {
        move |system: &System| {
            let (asked, failed) = system.slot(slot).unwrap().slot.requestor(port).unwrap().counts();
            (asked, u64::from(failed))
        }
    };
    for (transport, executors) in SIDES {
        measure(&query::profiles(transport, "measure"), executors, 5_000, calls("asker", "tell"));
        for port in ["order", "board/turn", "board/beep"] {
            measure(&send::profiles(transport, "measure"), executors, 5_000, calls("sender", port));
        }
        measure(&event::profiles(transport, "measure", crate::rig::RESET), executors, 1_000, |system| {
            let (_, fired, lost) = system.slot("measurer").unwrap().slot.events.servers[0].counts();
            (fired, lost)
        });
    }
}
