//! Values that are passed on, to one reader or a hundred, and readers that are connected and disconnected meanwhile: nobody
//! in the daemon uses its allocator once everything was done before.
#![allow(unsafe_code, reason = "a counting allocator")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use framework_daemon::port::wiring::{Name, connect, disconnect};
use framework_daemon::supervise::system::System as Running;
use tests::bench::wire::{Bench, on};

const PATIENCE: Duration = Duration::from_secs(30);
const READERS: usize = 100;
const ROUNDS: usize = 500;
const HOPS: u64 = 300;

/// Counts while somebody watches, on every thread.
struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

static WATCHING: AtomicBool = AtomicBool::new(false);
static USED: AtomicUsize = AtomicUsize::new(0);

fn note() {
    if WATCHING.load(Ordering::Relaxed) {
        USED.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: everything is the system's allocator; counting touches no memory of the caller.
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

fn cycles(system: &Running, slot: &str) -> u64 {
    system.slot(slot).unwrap().slot.status.cycles.load(Ordering::Relaxed)
}

/// Wires a reader to the ring and off it again while everything goes on, until each loop of writers went round often enough.
fn go_round(system: &Running) {
    let (from, to) = (Name { slot: "ping", port: "said" }, Name { slot: "spare", port: "heard" });
    let loops = ["ping", "caster", "far"];
    let before = loops.map(|slot| cycles(system, slot));
    let began = Instant::now();
    let mut round = 0;
    while round < ROUNDS || loops.iter().zip(before).any(|(slot, before)| cycles(system, slot) < before + HOPS) {
        assert!(began.elapsed() < PATIENCE, "all of them go on");
        connect(&system.registry, from, to).unwrap();
        disconnect(&system.registry, to).unwrap();
        round += 1;
    }
}

#[test]
fn hops_fan_out_and_rewiring_use_no_allocator() {
    let leads = [("leads", "bool", "true"), ("batch", "int", "500")];
    let mut slots = vec![
        on("one", "ping", "HopSmall", &leads),
        on("one", "pong", "HopSmall", &leads[1..]),
        on("one", "near", "HopSmall", &leads),
        on("other", "far", "HopSmall", &leads[1..]),
        on("other", "spare", "Ear", &[]),
        on("one", "caster", "Caster", &[]),
    ];
    slots.extend((0..READERS).map(|number| {
        let answers = if number + 1 == READERS { "true" } else { "false" };
        on("one", &format!("ear{number}"), "Ear", &[("answers", "bool", answers)])
    }));
    let mut connections: Vec<_> = (0..READERS).map(|number| format!("caster.said -> ear{number}.heard")).collect();
    connections.push(format!("ear{}.said -> caster.heard", READERS - 1));
    connections.extend(
        ["ping.said -> pong.heard", "pong.said -> ping.heard", "near.said -> far.heard", "far.said -> near.heard"]
            .map(str::to_owned),
    );
    let connections: Vec<_> = connections.iter().map(String::as_str).collect();
    WATCHING.store(true, Ordering::SeqCst);
    let bench = Bench::start("other", &slots, &connections);
    WATCHING.store(false, Ordering::SeqCst);
    assert_ne!(USED.swap(0, Ordering::SeqCst), 0, "it counts");
    go_round(bench.system());
    WATCHING.store(true, Ordering::SeqCst);
    go_round(bench.system());
    WATCHING.store(false, Ordering::SeqCst);
    assert_eq!(USED.load(Ordering::SeqCst), 0, "uses of the allocator");
}
