//! `<recovery within>`: each recovery is held against it, a breach is a fault of its own, and nothing loops.

use std::process::Command;

use serde_json::Value;
use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, application, slot};
use tests::running::Running;

/// A ticker that is reset after faults, with a target and whatever rules besides.
fn ticker(within: &str, rules: &str) -> Profiles {
    let rules = format!(
        "<fault_tolerance><severity>reset</severity>{rules}<reset limit=\"100\" within=\"60s\"/>\
         <recovery within=\"{within}\"/></fault_tolerance>"
    );
    Profiles::new(&application(&[slot("ticker", "Ticker", &rules)], &[]))
}

/// Faults of the run: symptom, action, outcome.
fn told(faults: &[Value]) -> Vec<[&str; 3]> {
    faults.iter().map(|fault| ["symptom", "action", "outcome"].map(|name| fault[name].as_str().unwrap())).collect()
}

const CRASHES: [&str; 4] = ["--inject", "ticker:crash.segv@0.2", "--inject", "ticker:crash.panic@0.4"];

/// Nothing recovers within a nanosecond.
const BREACH: &str = "0.001us";

fn info(daemon: &Running) -> Value {
    let mut command = Command::new(daemon_binary());
    command.args(["component", "info", "ticker", "--format", "json", "--socket"]).arg(daemon.socket());
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_breach_is_a_fault_with_both_times_and_a_reset_of_all_does_not_mean_it() {
    let mut daemon = Running::start(ticker(BREACH, "").path(), &CRASHES);
    let faults = daemon.journal("fault", 4);
    let late = ["late", "ignore", "ignored"];
    let crashes = ["crash.segv", "crash.panic"].map(|symptom| [symptom, "reset", "recovered"]);
    assert_eq!(told(&faults), [crashes[0], late, crashes[1], late]);
    let evidence = &faults[1]["evidence"];
    assert_eq!((evidence["kind"].as_str(), evidence["declared_ns"].as_u64()), (Some("recovery"), Some(1)));
    assert_eq!(evidence["took_ns"], faults[0]["times"]["first_callback_ns"]);
    daemon.wait_for("it recovered later than declared: ");
    let info = info(&daemon);
    let number = |name: &str| info["component"][name].as_u64().unwrap_or_else(|| panic!("{name} of {info}"));
    assert_eq!((number("recovery_within_ns"), number("recoveries_late")), (1, 2));
    assert_eq!(number("recovery_last_ns"), faults[3]["evidence"]["took_ns"].as_u64().unwrap());
    assert!(number("recovery_worst_ns") >= number("recovery_last_ns"));
    daemon.stop();
}

#[test]
fn a_target_that_is_met_is_measured_and_nothing_more() {
    let mut daemon = Running::start(ticker("600s", "").path(), &CRASHES);
    assert!(told(&daemon.journal("fault", 2)).iter().all(|[symptom, ..]| *symptom != "late"));
    assert!(info(&daemon)["component"]["recovery_last_ns"].as_u64() > Some(0));
    assert_eq!(daemon.stop()[0]["faults"], 2);
}

#[test]
fn a_reset_for_being_late_is_not_late_again() {
    let mut daemon =
        Running::start(ticker(BREACH, "<severity symptom=\"late\">reset</severity>").path(), &CRASHES[..2]);
    let faults = daemon.journal("fault", 2);
    assert_eq!(told(&faults), [["crash.segv", "reset", "recovered"], ["late", "reset", "recovered"]]);
    std::thread::sleep(std::time::Duration::from_millis(200));
    let slots = daemon.stop();
    assert_eq!((slots[0]["faults"].as_u64(), slots[0]["state"].as_str()), (Some(2), Some("active")));
}

#[test]
fn a_slot_that_must_not_be_late_stops() {
    let mut daemon = Running::start(ticker(BREACH, "<severity symptom=\"late\">stop</severity>").path(), &CRASHES[..2]);
    assert_eq!(told(&daemon.journal("fault", 2))[1], ["late", "stop", "stopped"]);
    assert_eq!(daemon.stop()[0]["state"], "error");
}
