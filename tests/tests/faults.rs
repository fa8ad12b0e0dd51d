//! Faults: contained, blamed on the right slot, answered by the rules, written down.

use serde_json::Value;
use tests::profiles::{Profiles, application, slot};
use tests::running::Running;

const SYMPTOMS: [&str; 9] = [
    "crash.panic",
    "crash.segv",
    "crash.bus",
    "crash.fpe",
    "crash.ill",
    "crash.abort",
    "crash.stack",
    "error",
    "crash.exit",
];

fn rules(inside: &str) -> String {
    format!("<fault_tolerance>{inside}</fault_tolerance>")
}

fn chain(ticker: &str) -> Profiles {
    Profiles::new(&application(
        &[slot("ticker", "Ticker", ticker), slot("listener", "Listener", ""), slot("diary", "Diary", "")],
        &["ticker.out -> listener.heard"],
    ))
}

fn injections(slot: &str, symptoms: &[&str]) -> Vec<String> {
    let each = |(number, symptom): (usize, &&str)| format!("{slot}:{symptom}@{}", 0.2 + number as f64 * 0.1);
    symptoms.iter().enumerate().flat_map(|each_one| ["--inject".to_owned(), each(each_one)]).collect()
}

fn run(profiles: &Profiles, slot: &str, symptoms: &[&str]) -> Running {
    let arguments = injections(slot, symptoms);
    Running::start(profiles.path(), &arguments.iter().map(String::as_str).collect::<Vec<_>>())
}

fn field<'a>(entries: &'a [Value], name: &str) -> Vec<&'a str> {
    entries.iter().map(|entry| entry[name].as_str().unwrap_or("-")).collect()
}

#[test]
fn every_symptom_is_contained_and_the_slot_recovers() {
    let profiles = chain(&rules("<severity>reset</severity><reset limit=\"20\" within=\"60s\"/>"));
    let mut daemon = run(&profiles, "ticker", &SYMPTOMS);
    let faults = daemon.journal("fault", SYMPTOMS.len());
    assert_eq!(field(&faults, "symptom"), SYMPTOMS);
    assert!(field(&faults, "slot").iter().all(|slot| *slot == "ticker"));
    assert!(field(&faults, "outcome").iter().all(|outcome| *outcome == "recovered"));
    for fault in &faults {
        let times = &fault["times"];
        let steps: Vec<_> = ["detected_ns", "decided_ns", "ready_ns", "first_callback_ns"]
            .map(|step| times[step].as_u64().unwrap())
            .into();
        assert!(steps.is_sorted(), "{times}");
        assert_eq!(fault["injected"], true);
    }
    let slots = daemon.stop();
    let of = |name: &str| slots.iter().find(|slot| slot["slot"] == name).unwrap().clone();
    assert_eq!(of("ticker")["quarantined"], 7, "seven symptoms lose the instance");
    assert_eq!((of("ticker")["state"].as_str(), of("diary")["faults"].as_u64()), (Some("active"), Some(0)));
}

#[test]
fn a_panic_tells_message_and_place() {
    let profiles = chain(&rules("<severity>reset</severity>"));
    let daemon = run(&profiles, "ticker", &["crash.panic"]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!(fault["evidence"]["message"], "injected panic");
    assert!(
        fault["evidence"]["file"].as_str().unwrap().ends_with("inject.rs")
            && fault["evidence"]["line"].as_u64() > Some(0)
    );
    daemon.wait_for("ticker: on_error: crash.panic: injected panic");
    daemon.wait_for("ticker: reset");
}

#[test]
fn a_trap_gives_a_fresh_instance_that_is_told_why() {
    let profiles = chain(&rules("<severity>reset</severity>"));
    let daemon = run(&profiles, "ticker", &["crash.segv"]);
    daemon.wait_for("ticker: recovers from crash.segv");
    daemon.wait_for_lines("ticker: starts at 0", 2);
}

#[test]
fn without_rules_a_fault_stops_the_slot_and_nothing_else() {
    let profiles = chain("");
    let mut daemon = run(&profiles, "ticker", &["crash.segv"]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("stop"), Some("stopped")));
    std::thread::sleep(std::time::Duration::from_millis(200));
    let slots = daemon.stop();
    let states: Vec<_> = slots.iter().map(|slot| slot["state"].as_str().unwrap()).collect();
    assert_eq!(states, ["error", "active", "active"]);
}

#[test]
fn beyond_the_intensity_the_secondary_takes_over_then_the_slot_stops() {
    let profiles = chain(&rules(
        "<severity>reset</severity><reset limit=\"1\" within=\"60s\"/><secondary reference=\"Downer.xml\" preload=\"instance\"/>",
    ));
    let daemon = run(&profiles, "ticker", &["crash.segv", "crash.fpe", "crash.panic", "error"]);
    let faults = daemon.journal("fault", 4);
    assert_eq!(field(&faults, "action"), ["reset", "replace", "reset", "stop"]);
    assert_eq!(field(&faults, "class"), ["Ticker", "Ticker", "Downer", "Downer"]);
    assert_eq!(field(&faults, "successor"), ["Ticker", "Downer", "Downer", "-"]);
    daemon.wait_for("from downer");
}

#[test]
fn the_secondary_takes_over_however_far_it_is_prepared() {
    for preload in ["none", "library", "instance"] {
        let profiles = chain(&rules(&format!(
            "<severity>reset</severity><reset limit=\"0\" within=\"1s\"/><secondary reference=\"Downer.xml\" preload=\"{preload}\"/>"
        )));
        let daemon = run(&profiles, "ticker", &["crash.segv"]);
        let fault = daemon.journal("fault", 1).remove(0);
        assert_eq!(
            (fault["successor"].as_str(), fault["outcome"].as_str()),
            (Some("Downer"), Some("recovered")),
            "{preload}"
        );
        daemon.wait_for("from downer");
    }
}

#[test]
fn severity_is_by_symptom() {
    let profiles = chain(&rules(
        "<severity>stop</severity><severity symptom=\"error\">ignore</severity><severity symptom=\"crash\">reset</severity>",
    ));
    let daemon = run(&profiles, "ticker", &["error", "crash.panic", "crash.ill"]);
    let faults = daemon.journal("fault", 3);
    assert_eq!(field(&faults, "action"), ["ignore", "reset", "reset"]);
}

#[test]
fn a_fault_that_a_component_raises_is_its_own_wherever_it_raises_it() {
    let raised = rules("<severity symptom=\"raised\">ignore</severity>");
    let profiles = Profiles::new(&application(&[slot("diary", "Diary", ""), slot("moaner", "Moaner", &raised)], &[]));
    let mut daemon = Running::start(profiles.path(), &[]);
    let _ = daemon.journal("fault", 2);
    daemon.stop();
    let faults = daemon.journal("fault", 3);
    assert!(faults.iter().all(|fault| fault["slot"] == "moaner" && fault["symptom"] == "raised"));
    let messages: Vec<_> = faults.iter().map(|fault| fault["evidence"]["message"].as_str().unwrap()).collect();
    assert_eq!(messages, ["in initialize", "in on_execute", "in stop"]);
}

#[test]
fn callbacks_after_a_fault_come_in_order() {
    // Without a spare: the successor is made on the spot.
    let rules = rules("<severity>reset</severity><spare preload=\"none\"/>");
    let profiles = Profiles::new(&application(&[slot("diary", "Diary", &rules)], &[]));
    let mut daemon = run(&profiles, "diary", &["crash.panic", "crash.segv"]);
    let _ = daemon.journal("fault", 2);
    daemon.wait_for("hook recover");
    daemon.stop();
    let hooks: Vec<String> =
        daemon.lines("hook ").iter().map(|line| line.rsplit("hook ").next().unwrap_or_default().to_owned()).collect();
    let first = ["initialize", "start", "execute", "update", "error crash.panic", "reset"];
    let second = ["initialize", "recover crash.segv", "start", "execute", "update", "stop", "destroy"];
    assert_eq!(hooks, [&first[..], &second[..]].concat());
}
