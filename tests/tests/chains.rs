//! Chains of symptoms: one that comes of what a slot was fed is left to the answer to its root, and is a fault of the slot's
//! own where it outlives that.

use serde_json::Value;
use tests::profiles::{Profiles, application, connection, plugin_dir, slot};
use tests::running::Running;

/// The window in which a symptom is left to its root.
const WINDOW_NS: u64 = 500_000_000;

fn rules(symptom: &str, severity: &str) -> String {
    format!("<fault_tolerance><severity symptom=\"{symptom}\">{severity}</severity></fault_tolerance>")
}

fn property(name: &str, value: &str) -> String {
    format!("<property name=\"{name}\">{value}</property>")
}

/// A wave that sends what a script says, a filter that passes it on, and an ear, each on an executor of its own.
fn chain(script: &str, wave: &str, filter: &str, filter_properties: &str, ends: [&str; 2]) -> Profiles {
    let properties = |text: &str| format!("<properties>{text}</properties>");
    let slots = [
        slot("wave", "Wave", &(properties(&property("script", script)) + wave)),
        slot("filter", "Amplifier", &(properties(filter_properties) + filter)),
        slot("ear", "Ear", ""),
    ];
    let connections =
        [connection("wave.out -> filter.heard", ends[0]), connection("filter.said -> ear.heard", ends[1])];
    let connections: Vec<&str> = connections.iter().map(String::as_str).collect();
    let profiles = Profiles::new(&application(&slots, &connections));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles
}

const AT_MOST_5: &str = "<validity field=\"distance\"><max>5</max><on_invalid>pass</on_invalid></validity>";

fn told(faults: &[Value]) -> Vec<(&str, &str, &str)> {
    let text = |fault: &Value, name: &str| -> &'static str { fault[name].as_str().unwrap_or("-").to_owned().leak() };
    faults.iter().map(|fault| (text(fault, "slot"), text(fault, "action"), text(fault, "outcome"))).collect()
}

#[test]
fn a_filter_that_was_fed_garbage_is_not_reset_for_it() {
    let (wave, filter) = (rules("validity", "reset"), rules("validity", "reset"));
    let profiles = chain("1x100 9 1x300 9 1", &wave, &filter, "", [AT_MOST_5; 2]);
    let mut daemon = Running::start(profiles.path(), &[]);
    // The second one comes when the window of the first is long over.
    daemon.wait_for_lines("left to that", 2);
    daemon.stop();
    let faults = daemon.entries("fault");
    let reset = ("wave", "reset", "recovered");
    let left = ("filter", "await", "consequence");
    assert_eq!(told(&faults), [reset, left, reset, left]);
    for pair in faults.chunks(2) {
        let diagnosis = &pair[1]["diagnosis"];
        assert_eq!((&diagnosis["consequence_of"], diagnosis["left_to"].as_str()), (&pair[0]["seq"], Some("wave")));
        assert!(pair[0]["diagnosis"]["consequence_of"].is_null() && pair[0]["diagnosis"]["left_to"].is_null());
    }
}

#[test]
fn what_outlives_the_answer_to_its_root_is_answered() {
    let (wave, filter) = (rules("validity", "reset"), rules("validity", "reset"));
    // From then on the filter multiplies by nine by itself: what is told of once goes on.
    let broken = property("after", "101") + &property("then", "9");
    let profiles = chain("1x100 9 1", &wave, &filter, &broken, [AT_MOST_5; 2]);
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 3);
    let expected =
        [("wave", "reset", "recovered"), ("filter", "await", "consequence"), ("filter", "reset", "recovered")];
    assert_eq!(told(&faults[..3]), expected);
    let at = |number: usize| faults[number]["mono_ns"].as_u64().unwrap();
    assert!(at(2) - at(1) >= WINDOW_NS - 100_000_000, "{} ns", at(2) - at(1));
}

#[test]
fn silence_that_a_filter_hands_on_is_the_writers() {
    let (wave, filter) = (rules("stale", "reset"), rules("stale", "reset"));
    let profiles = chain("1x100 -", &wave, &filter, "", ["", ""]);
    let max_age = |file: &str, age: &str| {
        profiles.replace(file, "<usage>input</usage>", &format!("<usage>input</usage><max_age>{age}</max_age>"));
    };
    max_age("Amplifier.xml", "150ms");
    max_age("Ear.xml", "300ms");
    let daemon = Running::start(profiles.path(), &[]);
    // No reset helps a wave that has nothing to say: it is reset until its rules stop it, and the filter is blamed no sooner
    // than a window after that.
    let of = |slot: &'static str| daemon.entries("fault").into_iter().filter(move |fault| fault["slot"] == slot);
    daemon.until("the filter is reset", || of("filter").any(|fault| fault["outcome"] == "recovered"));
    let (wave, filter): (Vec<Value>, Vec<Value>) = (of("wave").collect(), of("filter").collect());
    assert_eq!(told(&filter[..2]), [("filter", "await", "consequence"), ("filter", "reset", "recovered")]);
    assert_eq!(filter[0]["diagnosis"]["left_to"], "wave");
    let at = |fault: &Value| fault["mono_ns"].as_u64().unwrap();
    let before: Vec<&Value> = wave.iter().filter(|fault| at(fault) < at(&filter[0])).collect();
    assert!(before.iter().any(|fault| fault["outcome"] == "recovered"), "{wave:?}");
    let last = wave.iter().filter(|fault| at(fault) + WINDOW_NS < at(&filter[1])).count();
    assert!(last >= before.len(), "{wave:?} {filter:?}");
}

#[test]
fn a_root_that_its_rules_ignore_is_nobodys_answer() {
    let filter = rules("validity", "reset");
    let profiles = chain("1x100 9 1", "", &filter, "", [AT_MOST_5; 2]);
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    let mut told = told(&faults);
    told.sort_unstable();
    assert_eq!(told, [("filter", "reset", "recovered"), ("wave", "ignore", "ignored")]);
}

#[test]
fn an_emergency_waits_for_nobody() {
    let (wave, filter) = (rules("validity", "reset"), rules("validity", "emergency"));
    let profiles = chain("1x100 9 1", &wave, &filter, "", [AT_MOST_5; 2]);
    let actuators = "<emergency><actuator component=\"ear\"/></emergency>";
    profiles.write("system.xml", &format!("<system_profile><name>robot</name>{actuators}</system_profile>"));
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    assert!(told(&faults).contains(&("filter", "emergency", "stopped")), "{faults:?}");
    let filter = faults.iter().find(|fault| fault["slot"] == "filter").unwrap();
    assert!(filter["diagnosis"]["left_to"].is_null());
}
