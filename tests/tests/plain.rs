//! The same components with all elements of fault tolerance removed run exactly as plain OPRoS would: a fault stops its slot,
//! and nothing else changes.

use serde_json::Value;
use tests::asking::ask;
use tests::profiles::{Profiles, application, connection, slot};
use tests::running::Running;

const RULES: &str = "<fault_tolerance><severity>reset</severity><severity symptom=\"validity\">ignore</severity><reset limit=\"5\" within=\"10s\"/><spare count=\"1\"/>\
    <checkpoint period=\"10ms\"/><recovery within=\"20ms\"/></fault_tolerance>";
const LIMITS: &str = "<validity field=\"range\"><min>0.5</min><max>3</max></validity>";

/// A sonar with its gauge, a ticker with its listener, and somebody who raises faults: with all that an integrator may add, or
/// without.
fn robot(tolerant: bool) -> Profiles {
    let only = |text: &'static str| if tolerant { text } else { "" };
    let slots =
        [("ticker", "Ticker"), ("listener", "Listener"), ("sonar", "Sonar"), ("gauge", "Gauge"), ("moaner", "Moaner")];
    let slots = slots.map(|(name, class)| slot(name, class, only(RULES)));
    let wires = ["ticker.out -> listener.heard".to_owned(), connection("sonar.out -> gauge.heard", only(LIMITS))];
    let profiles = Profiles::new(&application(&slots, &[wires[0].as_str(), wires[1].as_str()]));
    if tolerant {
        let needs = "<dependency component=\"listener\" on=\"ticker sonar\" require=\"2\"/></application_profile>";
        profiles.replace("app.xml", "</application_profile>", needs);
        let system =
            "<system_profile><name>robot</name><emergency><actuator component=\"gauge\"/></emergency></system_profile>";
        profiles.write("system.xml", system);
    }
    profiles
}

/// Number and sender of the first values that the listener heard.
fn heard(daemon: &Running) -> Vec<String> {
    daemon.wait_for_lines("heard ", 3);
    let lines = daemon.lines("heard ");
    lines.iter().filter_map(|line| line.split_once("heard ").map(|(_, text)| text.to_owned())).take(3).collect()
}

fn states(daemon: &Running) -> Vec<(String, String)> {
    let status = ask(daemon, "status --format json").json().remove(0);
    let text = |slot: &Value, name: &str| slot[name].as_str().unwrap().to_owned();
    let slots = status["slots"].as_array().unwrap();
    slots.iter().map(|slot| (text(slot, "slot"), text(slot, "state"))).collect()
}

#[test]
fn without_faults_both_do_the_same() {
    let seen = [true, false].map(|tolerant| {
        let profiles = robot(tolerant);
        let daemon = Running::start(profiles.path(), &[]);
        let heard = heard(&daemon);
        (heard, states(&daemon))
    });
    assert_eq!(seen[0], seen[1]);
    assert_eq!(seen[0].0, ["1 of 0 from ticker", "101 of 100 from ticker", "201 of 200 from ticker"]);
    assert!(seen[0].1.iter().all(|(_, state)| state == "active"));
}

#[test]
fn without_rules_each_fault_stops_its_slot_and_nothing_else_changes() {
    for symptom in ["crash.segv", "crash.panic", "error"] {
        let profiles = robot(false);
        let mut daemon = Running::start(profiles.path(), &["--inject", &format!("ticker:{symptom}@0.3")]);
        daemon.until("the ticker's fault", || daemon.entries("fault").iter().any(|fault| fault["slot"] == "ticker"));
        let faults = daemon.entries("fault");
        let stopped: Vec<_> = faults.iter().filter(|fault| fault["outcome"] == "stopped").collect();
        assert_eq!(stopped.len(), 1, "{faults:?}");
        assert_eq!((stopped[0]["symptom"].as_str(), stopped[0]["action"].as_str()), (Some(symptom), Some("stop")));
        let wanted = ["ticker", "listener", "sonar", "gauge", "moaner"]
            .map(|slot| (slot.to_owned(), if slot == "ticker" { "error" } else { "active" }.to_owned()));
        assert_eq!(states(&daemon), wanted);
        // Whatever is raised is written down and changes nothing; no value is checked.
        assert!(faults.iter().all(|fault| fault["slot"] == "ticker" || fault["symptom"] == "raised"), "{faults:?}");
        assert!(faults.iter().all(|fault| fault["slot"] == "ticker" || fault["outcome"] == "ignored"), "{faults:?}");
        let slots = daemon.stop();
        assert!(slots.iter().all(|slot| slot["slot"] == "ticker" || slot["cycles"].as_u64() > Some(0)), "{slots:?}");
        for kind in ["held", "returned", "emergency", "healed", "cleared"] {
            assert!(daemon.entries(kind).is_empty(), "{kind}");
        }
        let zeros = daemon.lines("zeros ").remove(0);
        assert!(!zeros.ends_with("zeros 0"), "what is not checked arrives as it is: {zeros}");
    }
}

#[test]
fn with_the_rules_the_same_fault_is_recovered_and_the_values_are_checked() {
    let profiles = robot(true);
    let mut daemon = Running::start(profiles.path(), &["--inject", "ticker:crash.segv@0.3"]);
    daemon.until("the ticker's fault", || daemon.entries("fault").iter().any(|fault| fault["slot"] == "ticker"));
    let fault = daemon.entries("fault").into_iter().find(|fault| fault["slot"] == "ticker").unwrap();
    assert_eq!(fault["outcome"], "recovered");
    daemon.stop();
    assert!(daemon.lines("zeros ").remove(0).ends_with("zeros 0"), "a bad value is kept from the gauge");
}
