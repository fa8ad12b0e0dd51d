//! A query uses no allocator of the daemon's once it runs: the allocator of this test counts.
#![allow(unsafe_code, reason = "a counting allocator")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU64, Ordering};
use std::time::Duration;

use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::sys::trap;
use tests::profiles::plugin_dir;

use crate::query::profiles;
use crate::rig::Transport;

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
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        note();
        // SAFETY: the caller's own promise.
        unsafe { System.dealloc(memory, layout) }
    }
}

/// Number of the thread of that name, if there is one.
fn thread_number(name: &str) -> Option<i32> {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap().map(Result::unwrap);
    let named =
        |path: &std::path::PathBuf| std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name);
    tasks.map(|task| task.path()).find(named)?.file_name()?.to_str()?.parse().ok()
}

fn measure(transport: Transport, executors: [&str; 2]) {
    let profiles = profiles(transport, "measure");
    let plan = load::load(profiles.path()).unwrap().plan;
    let (sender, _events) = crossbeam_channel::bounded(64);
    trap::install();
    let system = boot(Arc::new(plan), &[plugin_dir()], sender).unwrap();
    let port = Arc::clone(system.slot("asker").unwrap().slot.requestor("tell").unwrap());
    std::thread::sleep(Duration::from_millis(300));
    for (watched, name) in WATCHED.iter().zip(executors) {
        watched.store(thread_number(name).expect("the executor's thread bears its name"), Ordering::Relaxed);
    }
    let before = port.counts();
    NOTED.store(0, Ordering::SeqCst);
    WATCHING.store(true, Ordering::SeqCst);
    while port.counts().0 < before.0 + 5_000 {
        std::thread::sleep(Duration::from_millis(10));
    }
    WATCHING.store(false, Ordering::SeqCst);
    assert_eq!((NOTED.load(Ordering::SeqCst), port.counts().1), (0, before.1), "allocations and failed calls");
    drop(port);
    shutdown(system);
}

// One test, because few threads are watched at a time.
#[test]
fn a_query_uses_no_allocator_near_or_far() {
    measure(Transport::Near, ["main", "main"]);
    measure(Transport::Far, ["left", "right"]);
}
