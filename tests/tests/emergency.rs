//! The emergency stop: every actuator's bytes leave, it is latched, and only an operator takes it back.

use serde_json::Value;
use tempfile::TempDir;
use tests::asking::ask;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

const RULES: &str = "<fault_tolerance><severity symptom=\"crash\">emergency</severity></fault_tolerance>";

struct Robot {
    profiles: Profiles,
    lines: TempDir,
}

/// Two actuators, each on a line of its own, and a sensor.
fn robot(sensor: &str, left: &str) -> Robot {
    let lines = TempDir::new().unwrap();
    let brake = |name: &str, rules: &str| {
        let path = lines.path().join(name);
        let line =
            format!("<properties><property name=\"line\" type=\"string\">{}</property></properties>", path.display());
        slot(name, "Brake", &(line + rules))
    };
    let slots =
        [slot("sensor", "Witness", sensor), slot("idle", "Witness", ""), brake("left", left), brake("right", "")];
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.write(
        "system.xml",
        "<system_profile><name>robot</name><emergency><actuator component=\"left\"/><actuator component=\"right\"/>\
         </emergency></system_profile>",
    );
    Robot { profiles, lines }
}

impl Robot {
    /// What was written to an actuator's line.
    fn line(&self, name: &str) -> Vec<String> {
        let text = std::fs::read_to_string(self.lines.path().join(name)).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }
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
    let cleared = ask(&daemon, "fault clear");
    assert_eq!(
        (cleared.code, cleared.out.as_str()),
        (Some(0), "the emergency stop is cleared\nleft: active\nright: active\n")
    );
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
    assert_eq!(cleared.out, "the emergency stop is cleared\nleft: active\nright: active\n");
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
fn it_stays_latched_until_an_operator_clears_it_whatever_ends_the_daemon() {
    let robot = robot(RULES, "");
    let journal = robot.lines.path().join("journal.jsonl");
    let run = |arguments: &[&str]| Running::spawn_on(&journal, robot.profiles.path(), arguments).ready();
    let mut daemon = run(&["--inject", "sensor:crash.segv@0.3"]);
    stopped(&daemon);
    daemon.signal("KILL");
    daemon.wait();
    // Killed, crashed, ended in order.
    for (arguments, ends) in [(&[][..], "KILL"), (&["--inject", "daemon:crash.segv@0.3"], ""), (&[], "TERM")] {
        let driven = robot.line("left").iter().filter(|text| *text == "drive").count();
        let mut daemon = run(arguments);
        daemon.wait_for("the run before left it latched");
        assert_eq!(robot.line("left").last().map(String::as_str), Some("stop"), "its outputs are safe");
        assert_eq!(daemon.entries("emergency").last().unwrap()["step"], "restored");
        if ends.is_empty() {
            daemon.wait();
        } else {
            let status = ask(&daemon, "status");
            assert!(status.out.starts_with("EMERGENCY STOP latched"), "{status:?}");
            assert_eq!(ask(&daemon, "component start left").code, Some(7));
            daemon.signal(ends);
            daemon.wait();
        }
        assert_eq!(robot.line("left").iter().filter(|text| *text == "drive").count(), driven, "{ends}");
    }
    let mut daemon = run(&[]);
    assert_eq!(ask(&daemon, "fault clear").out, "the emergency stop is cleared\nleft: active\nright: active\n");
    daemon.until("the wheels turn again", || robot.line("left").last().is_some_and(|text| text == "drive"));
    daemon.stop();
    let daemon = run(&[]);
    assert_eq!(ask(&daemon, "status --format json").json()[0]["emergency"], false);
}

#[test]
fn a_fresh_run_forgets_that_it_was_latched() {
    let robot = robot(RULES, "");
    let journal = robot.lines.path().join("journal.jsonl");
    let mut daemon = Running::spawn_on(&journal, robot.profiles.path(), &["--inject", "sensor:crash.segv@0.3"]).ready();
    stopped(&daemon);
    daemon.stop();
    let daemon = Running::spawn_on(&journal, robot.profiles.path(), &["--fresh"]).ready();
    assert_eq!(ask(&daemon, "status --format json").json()[0]["emergency"], false);
    daemon.until("the wheels turn", || robot.line("left").last().is_some_and(|text| text == "drive"));
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
        let answer = std::cell::RefCell::new(String::new());
        daemon.until("somebody has cleared it", || {
            let asked = ask(&daemon, "fault clear");
            answer.replace(asked.out);
            asked.code == Some(0)
        });
        assert_eq!(answer.into_inner(), "the emergency stop is cleared\nleft: active\nright: active\n");
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
    let expected =
        format!("the emergency stop is cleared\nleft: error, fault {} stopped it\nright: active\n", own["seq"]);
    assert_eq!(cleared.out, expected);
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
