//! Readers that are wired while a system runs, and what a reload makes of it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use component_sdk::status::Status;
use framework_daemon::port::wiring::{Name, connect, disconnect};
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::boot;
use framework_daemon::supervise::reload::reload;
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::supervise::system::System;
use framework_daemon::sys::trap;
use tests::profiles::{Profiles, application, plugin_dir, slot};

const PATIENCE: Duration = Duration::from_secs(20);
const OUT: Name<'static> = Name { slot: "ticker", port: "out" };

/// Names are those of the system that runs in this process: one at a time.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn heard(slot: &str) -> Name<'_> {
    Name { slot, port: "heard" }
}

fn app(more: &[String], connections: &[&str]) -> String {
    let mut slots = ["one", "two", "three"].map(|name| slot(name, "Listener", "")).to_vec();
    slots.insert(0, slot("ticker", "Ticker", ""));
    slots.extend_from_slice(more);
    application(&slots, connections)
}

fn received(system: &System, slot: &str) -> u64 {
    system.slot(slot).unwrap().slot.input("heard").unwrap().counts().0
}

/// True when that slot hears something new.
fn hears(system: &System, slot: &str) -> bool {
    let before = received(system, slot);
    let began = Instant::now();
    while received(system, slot) < before + 5 {
        if began.elapsed() > PATIENCE {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    true
}

/// True when that slot hears nothing, while others do.
fn is_deaf(system: &System, slot: &str, other: &str) -> bool {
    // What was on its way has arrived when the other one has heard something.
    assert!(hears(system, other));
    let before = received(system, slot);
    hears(system, other) && received(system, slot) == before
}

fn change(system: &mut System, profiles: &Profiles, application: &str) {
    profiles.write("app.xml", application);
    let plan = Arc::new(load::load(profiles.path()).unwrap().plan);
    reload(system, &plan, &[plugin_dir()]).unwrap();
}

fn running(application: &str) -> (Profiles, System) {
    trap::install();
    let profiles = Profiles::new(application);
    let plan = Arc::new(load::load(profiles.path()).unwrap().plan);
    // Faults are none here.
    let (sender, _events) = crossbeam_channel::bounded(64);
    let system = boot(plan, &[plugin_dir()], sender).unwrap();
    (profiles, system)
}

#[test]
fn a_reader_is_wired_while_all_runs_and_others_notice_nothing() {
    let _alone = alone();
    let (_profiles, system) = running(&app(&[], &["ticker.out -> one.heard"]));
    connect(&system.registry, OUT, heard("two")).unwrap();
    assert!(hears(&system, "two") && hears(&system, "one"));
    disconnect(&system.registry, heard("two")).unwrap();
    assert!(is_deaf(&system, "two", "one"));
    // Disconnecting what is not connected is no mistake.
    disconnect(&system.registry, heard("two")).unwrap();
    connect(&system.registry, heard("three"), OUT).unwrap();
    assert!(hears(&system, "three"));
    let refusal = connect(&system.registry, OUT, heard("four")).unwrap_err();
    assert_eq!(refusal.cause, Status::ServiceUnavailable);
    disconnect(&system.registry, OUT).unwrap();
    let before = ["one", "two", "three"].map(|slot| received(&system, slot));
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(before, ["one", "two", "three"].map(|slot| received(&system, slot)));
    shutdown(system);
}

#[test]
fn a_reload_wires_what_plans_speak_of_and_leaves_the_rest() {
    let _alone = alone();
    let (profiles, mut system) = running(&app(&[], &["ticker.out -> one.heard"]));
    connect(&system.registry, OUT, heard("two")).unwrap();
    let more = [slot("diary", "Diary", "")];
    change(&mut system, &profiles, &app(&more, &["ticker.out -> three.heard"]));
    assert!(hears(&system, "two"), "made at run time, and no plan speaks of it");
    assert!(hears(&system, "three"), "the new plan says so");
    assert!(is_deaf(&system, "one", "two"), "the new plan does not");
    // A new writer is another one: what somebody had connected to the old one is not.
    let renamed = app(&more, &["ticker.out -> three.heard"]).replacen("Ticker.xml", "Downer.xml", 1);
    change(&mut system, &profiles, &renamed);
    assert!(hears(&system, "three"));
    assert!(is_deaf(&system, "two", "three"));
    connect(&system.registry, OUT, heard("two")).unwrap();
    assert!(hears(&system, "two"), "the new writer is known by its name");
    let without: Vec<String> = ["one", "three"].map(|name| slot(name, "Listener", "")).to_vec();
    let ticker = slot("ticker", "Downer", "");
    change(&mut system, &profiles, &application(&[&[ticker], &without[..]].concat(), &["ticker.out -> three.heard"]));
    assert!(hears(&system, "three"));
    assert_eq!(connect(&system.registry, heard("two"), OUT).unwrap_err().cause, Status::UnknownComponent);
    shutdown(system);
}
