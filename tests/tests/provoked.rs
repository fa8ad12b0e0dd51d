//! What can be provoked is found as what it is, and marked as provoked.

use component_sdk::abi::inject::INJECTIONS;
use serde_json::Value;
use tests::profiles::{Profiles, application, slot};
use tests::running::Running;

const RULES: &str = "<fault_tolerance><severity>reset</severity><severity symptom=\"device\">reset</severity><reset limit=\"1000\" within=\"10s\"/></fault_tolerance>";

fn ticker(rules: &str) -> Profiles {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", rules)], &[]));
    let deadline = "<deadline hang=\"3s\">300ms</deadline></execution_semantics>";
    profiles.replace("Ticker.xml", "</execution_semantics>", deadline);
    profiles
}

#[test]
fn each_symptom_that_can_be_provoked_is_found_and_answered() {
    let symptoms = || INJECTIONS.into_iter().map(|(name, _)| name).filter(|name| *name != "device.found");
    let injections = symptoms().enumerate().map(|(place, name)| format!("ticker:{name}@{}.3", place / 2));
    let arguments: Vec<String> = injections.flat_map(|text| ["--inject".to_owned(), text]).collect();
    let profiles = ticker(RULES);
    let mut daemon = Running::start(profiles.path(), &arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let found = |name: &str| daemon.entries("fault").into_iter().find(|fault| fault["symptom"] == name);
    for name in symptoms() {
        daemon.until(&format!("`{name}`"), || found(name).is_some());
        let fault = found(name).unwrap();
        let words = ["action", "outcome"].map(|field| fault[field].as_str().unwrap_or("-"));
        assert_eq!((words, &fault["injected"]), (["reset", "recovered"], &Value::Bool(true)), "{fault}");
    }
    let slots = daemon.stop();
    assert_eq!(slots[0]["state"], "active", "it works on");
}

#[test]
fn a_device_that_was_lost_for_a_drill_is_found_again() {
    let profiles = ticker("");
    let arguments = ["--inject", "ticker:device@0.2", "--inject", "ticker:device.found@0.5"];
    let daemon = Running::start(profiles.path(), &arguments);
    let healed = daemon.journal("healed", 1).remove(0);
    let lost = daemon.journal("fault", 1).remove(0);
    assert_eq!((&lost["symptom"], &lost["injected"]), (&"device".into(), &Value::Bool(true)), "{lost}");
    for told in [&lost, &healed] {
        assert_eq!(told["evidence"]["device"], "injected", "{told}");
    }
    assert!(healed["evidence"]["lost_ns"].as_u64() > Some(0), "{healed}");
}

#[test]
fn where_nothing_would_be_found_that_is_wrong_usage() {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", "")], &[]));
    let mut daemon = Running::spawn(profiles.path(), &["--inject", "ticker:overrun@1"]);
    assert_eq!(daemon.wait().code(), Some(2));
    daemon.wait_for("ticker has no <deadline>: no overrun would be found");
    // A value has its rules, a silence its reader: only those who write or wait can have them.
    let mut daemon = Running::spawn(profiles.path(), &["--inject", "ticker:validity@1"]);
    assert_eq!(daemon.wait().code(), Some(2));
    daemon.wait_for("`validity` cannot be provoked; these can: crash.panic, ");
}
