//! Callbacks that wait: their neighbours on the same executor run meanwhile, and nothing waits for ever.

use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

const MAIN: &str = "<executor>main</executor>";

/// A slot that sleeps so long in each callback, with rules, and others beside it on the same executor.
fn sleeper(milliseconds: u64, rules: &str, others: &[String]) -> Profiles {
    let inside = format!(
        "<properties><property name=\"sleep\" type=\"long\">{milliseconds}</property></properties>{MAIN}{rules}"
    );
    let mut slots = vec![slot("sleeper", "Sleeper", &inside)];
    slots.extend_from_slice(others);
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.executors(&["main"]);
    profiles
}

#[test]
fn a_callback_that_sleeps_keeps_nobody_from_its_period() {
    let profiles = sleeper(15, "", &[slot("ticker", "Ticker", MAIN)]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("slept 20: whole");
    let slots = daemon.stop();
    let [sleeper, ticker] = ["sleeper", "ticker"].map(|name| slots.iter().find(|slot| slot["slot"] == name).unwrap());
    let count = |slot: &serde_json::Value, what: &str| slot[what].as_u64().unwrap();
    // A callback of 15 ms each second period of 10 ms; the ticker's period is 2 ms.
    assert!(count(sleeper, "missed") >= 19, "{sleeper}");
    assert!(count(ticker, "cycles") > 7 * count(sleeper, "cycles"), "{ticker} beside {sleeper}");
    assert_eq!((count(sleeper, "faults"), count(ticker, "faults")), (0, 0));
    // What it slept is not what it took.
    assert!(count(sleeper, "longest_ns") < 15_000_000, "{sleeper}");
}

#[test]
fn a_wait_is_no_hang_and_no_overrun() {
    let profiles = sleeper(60, "", &[]);
    let semantics = "<execution_semantics>";
    profiles.replace("Sleeper.xml", semantics, &format!("{semantics}<deadline hang=\"20ms\">10ms</deadline>"));
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("slept 3: whole");
    assert_eq!(daemon.stop()[0]["faults"], 0);
}

#[test]
fn who_is_to_stop_is_told_so_and_waits_no_longer() {
    let profiles = sleeper(3_600_000, "", &[]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("may sleep here: false");
    std::thread::sleep(std::time::Duration::from_millis(50));
    let slots = daemon.stop();
    daemon.wait_for("slept 1: ended");
    assert_eq!(slots[0]["faults"], 0);
}

#[test]
fn who_waits_goes_on_when_a_neighbour_loses_their_thread() {
    let rules = "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";
    let how = "<properties><property name=\"how\" type=\"string\">sleep</property></properties>";
    let profiles = sleeper(15, "", &[slot("stuck", "Stuck", &format!("{how}{MAIN}{rules}"))]);
    profiles.describe(&plugin_dir().join("libhostile.so"));
    let semantics = "<execution_semantics>";
    profiles.replace("Stuck.xml", semantics, &format!("{semantics}<deadline hang=\"20ms\">10ms</deadline>"));
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 5);
    assert!(faults.iter().all(|fault| fault["slot"] == "stuck" && fault["thread_lost"] == true), "{faults:?}");
    daemon.wait_for("slept 10: whole");
    let slots = daemon.stop();
    let sleeper = slots.iter().find(|slot| slot["slot"] == "sleeper").unwrap();
    assert_eq!(sleeper["faults"], 0);
}

#[test]
fn an_instance_that_failed_in_its_sleep_is_replaced() {
    let rules = "<fault_tolerance><severity>reset</severity></fault_tolerance>";
    let profiles = sleeper(15, rules, &[]);
    let mut daemon = Running::start(profiles.path(), &["--inject", "sleeper:crash.segv@0.1"]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!(fault["outcome"], "recovered");
    // Its successor sleeps in its first callback: it is at work, and that callback is not over.
    assert!(fault["times"]["first_callback_ns"].is_null(), "{fault}");
    daemon.wait_for("slept 3: whole");
    daemon.stop();
}
