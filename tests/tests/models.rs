//! A component is compared with a model of it, which the framework feeds with the same input.

use serde_json::Value;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

/// All on one executor: whatever delays one delays all.
const HERE: &str = "<executor>main</executor>";

fn amplifier(name: &str, properties: &[(&str, &str)], rules: &str) -> String {
    let property =
        |(name, value): &(&str, &str)| format!("<property name=\"{name}\" type=\"std::string\">{value}</property>");
    let properties: String = properties.iter().map(property).collect();
    let inside = format!("{HERE}<properties>{properties}</properties><fault_tolerance>{rules}</fault_tolerance>");
    slot(name, "Amplifier", &inside)
}

/// A wave that drives a plant; a model that nobody connects; the ear hears the plant.
fn plant(script: &str, plant: &[(&str, &str)], rules: &str, model: &str) -> Profiles {
    let script =
        format!("{HERE}<properties><property name=\"script\" type=\"std::string\">{script}</property></properties>");
    let slots = [
        slot("wave", "Wave", &script),
        amplifier("plant", plant, rules),
        amplifier("model", &[("gain", "2")], ""),
        slot("ear", "Ear", HERE),
    ];
    let text = application(&slots, &["wave.out -> plant.heard", "plant.said -> ear.heard"]);
    let model = format!("<reference_model component=\"model\" {model}/>\n</application_profile>");
    let profiles = Profiles::new(&text.replace("</application_profile>", &model));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles.executors(&["main"]);
    profiles
}

const COMPARED: &str =
    "input=\"plant.heard\" target=\"plant.said\" field=\"distance\" window=\"100ms\" threshold=\"3\"";

#[test]
fn a_plant_that_does_less_than_its_model_is_found_once() {
    let profiles = plant("10", &[("gain", "2"), ("after", "100"), ("then", "1")], "", COMPARED);
    let mut daemon = Running::start(profiles.path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("plant"), Some("model")));
    let evidence = &fault["evidence"];
    assert_eq!((evidence["kind"].as_str(), evidence["port"].as_str()), (Some("model"), Some("plant.said")));
    assert_eq!((evidence["threshold"].as_f64(), evidence["window_ns"].as_u64()), (Some(3.0), Some(100_000_000)));
    let number = |name: &str| evidence[name].as_f64().unwrap();
    assert!((number("model") - 20.0).abs() < 1e-9, "{evidence}");
    assert!((number("model") - number("target") - number("difference")).abs() < 1e-9 && number("difference") > 3.0);
    daemon.wait_for("slot plant (Amplifier): model: plant.said, field distance: ");
    let status = tests::asking::ask(&daemon, "status --format json").json().remove(0);
    assert_eq!(status["helpers"][0]["kind"], "model");
    assert!(status["helpers"][0]["difference"].as_f64() > Some(3.0), "{status}");
    daemon.stop();
    assert_eq!(daemon.entries("fault").len(), 1);
}

#[test]
fn a_plant_that_does_what_its_model_says_is_never_blamed() {
    // The wave jumps; both follow it.
    let profiles = plant("10x7 90x5 -30x3 ...", &[("gain", "2")], "", COMPARED);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for_lines("distance ", 15);
    let status = tests::asking::ask(&daemon, "status --format json").json().remove(0);
    assert!(status["helpers"][0]["difference"].is_number(), "it was compared: {status}");
    daemon.stop();
    assert_eq!(daemon.entries("fault"), [] as [Value; 0]);
}

#[test]
fn the_rules_of_the_target_answer_and_its_successor_is_judged_anew() {
    let rules = "<severity symptom=\"model\">reset</severity><reset limit=\"2\" within=\"600s\"/>";
    let profiles = plant("10", &[("gain", "1")], rules, COMPARED);
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 3);
    let of = |name: &str| faults.iter().map(|fault| fault[name].as_str().unwrap()).collect::<Vec<_>>();
    assert_eq!(of("outcome"), ["recovered", "recovered", "stopped"]);
    assert_eq!(of("slot"), ["plant"; 3]);
    let at = |fault: &Value| fault["mono_ns"].as_u64().unwrap();
    assert!(faults.windows(2).all(|two| at(&two[1]) - at(&two[0]) >= 90_000_000), "each after a full window");
    daemon.stop();
}

#[test]
fn a_reload_keeps_what_the_window_holds_and_takes_a_new_threshold() {
    let profiles =
        plant("10", &[("gain", "2"), ("after", "60"), ("then", "1")], "", &COMPARED.replace("\"3\"", "\"100\""));
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for_lines("distance ", 10);
    assert!(daemon.entries("fault").is_empty());
    profiles.replace("app.xml", "threshold=\"100\"", "threshold=\"3\"");
    daemon.signal("HUP");
    assert_eq!(daemon.journal("fault", 1)[0]["slot"], "plant");
    profiles.replace("app.xml", "<reference_model", "<!-- <reference_model");
    profiles.replace("app.xml", "threshold=\"3\"/>", "threshold=\"3\"/> -->");
    daemon.signal("HUP");
    daemon.wait_for_lines("reloaded: ", 2);
    let ports = tests::asking::ask(&daemon, "port list --format json").json();
    let said = ports.iter().find(|port| port["slot"] == "plant" && port["port"] == "said").unwrap();
    assert!(said["heard_by"].is_null(), "{said}");
    let model = ports.iter().find(|port| port["slot"] == "model" && port["port"] == "heard").unwrap();
    assert_eq!(model["connections"], serde_json::json!([]));
    daemon.stop();
}
