//! Signals that go wrong are found at the ports: silence, jumps, limits that depend on other fields.

use serde_json::Value;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

fn rules(inside: &str) -> String {
    format!("<fault_tolerance>{inside}</fault_tolerance>")
}

fn script(script: &str) -> String {
    format!("<properties><property name=\"script\" type=\"std::string\">{script}</property></properties>")
}

fn wave(text: &str, inside: &str) -> String {
    slot("wave", "Wave", &format!("{}{}", script(text), rules(inside)))
}

/// A wave and an ear, connected, with something added to the ear's input.
fn heard(wave: &str, port: &str) -> Profiles {
    let profiles = Profiles::new(&application(&[wave.to_owned(), slot("ear", "Ear", "")], &["wave.out -> ear.heard"]));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles.replace("Ear.xml", "<usage>input</usage>", &format!("<usage>input</usage>{port}"));
    profiles
}

fn texts<'a>(entries: &'a [Value], name: &str) -> Vec<&'a str> {
    entries.iter().map(|entry| entry[name].as_str().unwrap_or("-")).collect()
}

#[test]
fn a_writer_that_falls_silent_is_blamed_once_and_its_silence_ends() {
    let profiles = heard(&wave("1x100 -x100 ...", ""), "<max_age>100ms</max_age>");
    let daemon = Running::start(profiles.path(), &[]);
    let (faults, healed) = (daemon.journal("fault", 2), daemon.journal("healed", 2));
    assert_eq!(texts(&faults[..2], "slot"), ["wave", "wave"]);
    assert_eq!(texts(&faults[..2], "symptom"), ["stale", "stale"]);
    assert_eq!(texts(&healed[..2], "outcome"), ["healed", "healed"]);
    let at = |line: &Value| line["mono_ns"].as_u64().unwrap();
    assert!(at(&faults[0]) < at(&healed[0]) && at(&healed[0]) < at(&faults[1]), "one fault a silence");
    for fault in &faults {
        let evidence = &fault["evidence"];
        assert_eq!((evidence["kind"].as_str(), evidence["port"].as_str()), (Some("silence"), Some("ear.heard")));
        assert!(evidence["silent_ns"].as_u64() >= Some(100_000_000) && evidence["max_age_ns"] == 100_000_000);
    }
    daemon.wait_for("slot wave (Wave): stale: ear.heard heard nothing for ");
    daemon.wait_for("slot wave (Wave): stale healed: ear.heard");
}

#[test]
fn a_reader_that_starts_late_counts_from_its_start() {
    // The first value comes after 400 ms only: neither earlier than 300 ms nor from the time of the boot.
    let profiles = heard(&wave("-x80 1", ""), "<max_age>300ms</max_age>");
    let daemon = Running::start(profiles.path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    let silent_ns = fault["evidence"]["silent_ns"].as_u64().unwrap();
    assert!((300_000_000..20_000_000_000).contains(&silent_ns), "{fault}");
    let healed = daemon.journal("healed", 1).remove(0);
    assert!(healed["evidence"]["silent_ns"].as_u64() >= Some(300_000_000), "{healed}");
}

#[test]
fn the_rules_of_the_silent_writer_answer_on_its_own_executor() {
    let inside = "<severity symptom=\"stale\">reset</severity><reset limit=\"2\" within=\"600s\"/>";
    let profiles = heard(&wave("1x20 -", inside), "<max_age>60ms</max_age>");
    let mut daemon = Running::start(profiles.path(), &[]);
    // It stays silent whatever is done: each reset is waited for anew, until the ladder ends.
    let faults = daemon.journal("fault", 3);
    assert_eq!(texts(&faults, "outcome"), ["recovered", "recovered", "stopped"]);
    assert_eq!(texts(&faults, "action"), ["reset", "reset", "stop"]);
    let slots = daemon.stop();
    let state = |name: &str| slots.iter().find(|slot| slot["slot"] == name).unwrap()["state"].clone();
    assert_eq!((state("ear"), state("wave")), ("active".into(), "error".into()));
}

#[test]
fn an_input_that_nobody_is_connected_to_blames_nobody() {
    let profiles = Profiles::new(&application(&[wave("1", ""), slot("ear", "Ear", "")], &[]));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles.replace("Ear.xml", "<usage>input</usage>", "<usage>input</usage><max_age>20ms</max_age>");
    let mut daemon = Running::start(profiles.path(), &[]);
    std::thread::sleep(std::time::Duration::from_millis(300));
    daemon.stop();
    assert!(daemon.entries("fault").is_empty() && daemon.entries("healed").is_empty());
}
