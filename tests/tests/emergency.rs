//! The emergency stop: every actuator's bytes leave, it is latched, and only an operator takes it back.

use serde_json::Value;
use tests::asking::{Answer, ask};
use tests::brakes::{RULES, robot};
use tests::profiles::{plugin_dir, slot};
use tests::running::Running;

/// The lines behind the first, which says what was cleared.
fn actuators_of(cleared: &Answer) -> Vec<&str> {
    cleared.out.lines().skip(1).collect()
}

fn stopped(daemon: &Running) -> Vec<Value> {
    daemon.until("three lines of the emergency stop", || daemon.entries("emergency").len() >= 3);
    let lines = daemon.entries("emergency");
    let mut stopped: Vec<Value> = lines.iter().filter(|line| line["step"] == "stopped").cloned().collect();
    stopped.sort_by_key(|line| line["slot"].to_string());
    stopped
}

#[test]
fn all_actuators_stop_it_is_latched_and_an_operator_clears_it() {
    let robot = robot(RULES, "");
    let daemon = Running::start(robot.profiles.path(), &["--inject", "sensor:crash.segv@0.3"]);
    let actuators = stopped(&daemon);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("emergency"), Some("stopped")));
    let raised = daemon.entries("emergency").remove(0);
    assert_eq!((raised["step"].as_str(), raised["outputs"].as_u64()), (Some("raised"), Some(2)));
    assert_eq!(raised["root"], fault["seq"]);
    for (line, name) in actuators.iter().zip(["left", "right"]) {
        assert_eq!((line["slot"].as_str(), line["state"].as_str()), (Some(name), Some("inactive")));
        assert_eq!((&line["root"], line["outputs"].as_u64()), (&fault["seq"], Some(1)));
        let written = robot.line(name);
        let first = written.iter().position(|text| text == "stop").unwrap();
        assert!(first > 0 && written[..first].iter().all(|text| text == "drive"), "{written:?}");
        let ease = written.iter().position(|text| text == "ease").unwrap();
        assert!(first < ease, "the output comes before the callback: {written:?}");
        assert!(written[ease + 1..].iter().all(|text| text == "stop"), "{written:?}");
        assert_eq!(written.last().map(String::as_str), Some("stop"));
    }
    let status = ask(&daemon, "status");
    assert!(status.out.starts_with("EMERGENCY STOP latched") && status.out.contains("emergency stop"), "{status:?}");
    assert_eq!(ask(&daemon, "status --format json").json()[0]["emergency"], true);
    for words in
        ["component start left", "component reset sensor", "component start idle", "reload", "connect idle.a idle.b"]
    {
        assert_eq!(ask(&daemon, words).code, Some(7), "{words}");
    }
    assert_eq!(ask(&daemon, "component stop idle").code, Some(0), "to stop is always allowed");
    assert_eq!(daemon.entries("emergency").len(), 3, "who is told twice stops once");
    let cleared = ask(&daemon, "fault clear");
    assert!(cleared.out.starts_with("the emergency stop for crash.segv of sensor (fault "), "{cleared:?}");
    assert_eq!((cleared.code, actuators_of(&cleared)), (Some(0), vec!["left: active", "right: active"]));
    assert_eq!(ask(&daemon, "status --format json").json()[0]["emergency"], false);
    daemon.until("the wheels turn again", || robot.line("left").last().is_some_and(|text| text == "drive"));
    assert_eq!(ask(&daemon, "component reset sensor").out, "sensor: active\n");
}

#[test]
fn the_faulty_actuator_itself_is_stopped_by_its_safe_output_and_started_anew() {
    let robot = robot("", RULES);
    let daemon = Running::start(robot.profiles.path(), &["--inject", "left:crash.segv@0.3"]);
    let actuators = stopped(&daemon);
    assert_eq!((actuators[0]["state"].as_str(), actuators[1]["state"].as_str()), (Some("error"), Some("inactive")));
    for name in ["left", "right"] {
        assert_eq!(robot.line(name).last().map(String::as_str), Some("stop"), "{name}");
    }
    let cleared = ask(&daemon, "fault clear");
    assert_eq!(actuators_of(&cleared), ["left: active", "right: active"]);
}

#[test]
fn a_fault_stop_that_covers_the_system_is_an_emergency_and_stops_everything() {
    let rules = "<fault_tolerance><coverage>system</coverage></fault_tolerance>";
    let robot = robot(rules, "");
    let daemon = Running::start(robot.profiles.path(), &["--inject", "sensor:crash.segv@0.3"]);
    stopped(&daemon);
    let held = daemon.journal("held", 3);
    let idle = held.iter().find(|line| line["slot"] == "idle").unwrap();
    assert_eq!(idle["reason"], "covered by the fault of sensor");
    let cleared = ask(&daemon, "fault clear");
    assert!(cleared.out.contains("left: inactive, covered by the fault of sensor"), "{cleared:?}");
    assert_eq!(ask(&daemon, "component reset sensor").code, Some(0));
    let status = ask(&daemon, "status --format json").json().remove(0);
    assert!(status["slots"].as_array().unwrap().iter().all(|slot| slot["state"] == "active"), "{status}");
}

#[test]
fn a_component_connects_nothing_to_an_actuator_while_it_is_latched() {
    let robot = robot(RULES, "");
    robot.profiles.describe(&plugin_dir().join("libsignals.so"));
    let more = slot("plug", "Plug", "") + &slot("ear", "Ear", "");
    robot.profiles.replace("app.xml", "</subcomponents>", &format!("{more}</subcomponents>"));
    robot.profiles.replace("system.xml", "<emergency>", "<emergency><actuator component=\"ear\"/>");
    let daemon = Running::start(robot.profiles.path(), &["--inject", "sensor:crash.segv@0.5"]);
    daemon.wait_for("plug is connected");
    daemon.wait_for("the emergency stop is latched, and ear is an actuator: `framework-daemon fault clear` first");
    assert_eq!(ask(&daemon, "fault clear").code, Some(0));
    daemon.wait_for_lines("plug is connected", 2);
}

#[test]
fn whoever_clears_at_once_clears_what_it_was_raised_for() {
    let robot = robot("", RULES);
    let faults = [0.3, 1.3, 2.3].map(|at| format!("left:crash.segv@{at}"));
    let arguments: Vec<&str> = faults.iter().flat_map(|fault| ["--inject", fault]).collect();
    let daemon = Running::start(robot.profiles.path(), &arguments);
    for _ in faults.iter() {
        let answer = std::cell::RefCell::new(None);
        daemon.until("somebody has cleared it", || {
            let asked = ask(&daemon, "fault clear");
            asked.code == Some(0) && answer.replace(Some(asked)).is_none()
        });
        assert_eq!(actuators_of(&answer.into_inner().unwrap()), ["left: active", "right: active"]);
    }
}

#[test]
fn clearing_starts_no_actuator_that_another_fault_stopped() {
    let robot = robot(RULES, "");
    let faults = ["--inject", "left:crash.segv@0.2", "--inject", "sensor:crash.segv@0.8"];
    let daemon = Running::start(robot.profiles.path(), &faults);
    stopped(&daemon);
    let own = daemon.journal("fault", 2).remove(0);
    assert_eq!((own["slot"].as_str(), own["action"].as_str()), (Some("left"), Some("stop")));
    let cleared = ask(&daemon, "fault clear");
    let left = format!("left: error, fault {} stopped it", own["seq"]);
    assert_eq!(actuators_of(&cleared), [left.as_str(), "right: active"]);
    assert_eq!(ask(&daemon, "component reset left").out, "left: active\n");
}

#[test]
fn an_emergency_without_an_actuator_is_refused_at_load() {
    let robot = robot(RULES, "");
    robot.profiles.write("system.xml", "<system_profile><name>robot</name></system_profile>");
    let checked = tests::asking::check(robot.profiles.path());
    assert_eq!(checked.code, Some(3));
    assert!(
        checked.out.contains("a fault of \"sensor\" brings the robot to its safe state, but no actuator is named"),
        "{checked:?}"
    );
}
