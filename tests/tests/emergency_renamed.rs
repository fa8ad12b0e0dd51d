//! Actuators of then are held by a latch that the run before left, whatever the profiles say now, and whatever they are called.

use std::fs;
use std::path::{Path, PathBuf};

use tests::asking::ask;
use tests::brakes::{RULES, Robot, robot};
use tests::running::Running;

/// A robot whose last run was killed while it was latched.
fn latched() -> (Robot, PathBuf) {
    let robot = robot(RULES, "");
    let journal = robot.lines.path().join("state/journal.jsonl");
    let mut daemon = Running::spawn_on(&journal, robot.profiles.path(), &["--inject", "sensor:crash.segv@0.3"]).ready();
    daemon.until("its cause is written", || {
        fs::read_to_string(robot.lines.path().join("state/journal.jsonl.emergency"))
            .is_ok_and(|text| text.contains("crash.segv"))
    });
    daemon.signal("KILL");
    daemon.wait();
    (robot, journal)
}

fn driven(robot: &Robot) -> usize {
    ["left", "right"].iter().flat_map(|name| robot.line(name)).filter(|text| *text == "drive").count()
}

/// The next run of a robot whose profiles were changed meanwhile: nothing drives, and it says who is held and why.
fn held(robot: &Robot, journal: &Path, told: &[&str]) -> Running {
    let before = driven(robot);
    let daemon = Running::spawn_on(journal, robot.profiles.path(), &[]).ready();
    let (ready, status) = (daemon.lines("ready: ").remove(0), ask(&daemon, "status").out);
    for text in told {
        let (slot, reason) = text.split_once(": ").unwrap();
        assert!(ready.contains(&format!("{slot} (held: emergency stop: {reason}")), "{text}: {ready}");
        assert!(status.contains(&format!("held besides: {text}")), "{text}: {status}");
    }
    assert_eq!(status.matches("held besides: ").count(), told.len(), "{status}");
    let line = daemon.entries("emergency").pop().unwrap();
    assert_eq!(line["besides"].as_array().unwrap().len(), told.len(), "{line}");
    assert_eq!(driven(robot), before);
    daemon
}

/// Cleared, all of them run; returns what the operator is told.
fn clear(robot: &Robot, daemon: &Running) -> Vec<String> {
    let before = driven(robot);
    let cleared = ask(daemon, "fault clear");
    assert_eq!(cleared.code, Some(0), "{cleared:?}");
    daemon.until("the wheels turn again", || driven(robot) > before);
    assert!(!ask(daemon, "status").out.contains("held besides: "));
    cleared.out.lines().skip(1).map(str::to_owned).collect()
}

#[test]
fn what_the_profiles_name_no_more_is_held_all_the_same() {
    let (robot, journal) = latched();
    robot.profiles.replace("system.xml", "<actuator component=\"left\"/>", "");
    let daemon = held(&robot, &journal, &["left: it was an actuator when the emergency stop was raised"]);
    assert_eq!(clear(&robot, &daemon), ["left: active", "right: active"]);
}

#[test]
fn one_of_another_name_is_known_by_its_class() {
    let (robot, journal) = latched();
    robot.profiles.replace("app.xml", ">left<", ">port<");
    robot.profiles.replace("system.xml", "<actuator component=\"left\"/>", "");
    let told = "port: left was an actuator when the emergency stop was raised, and is no slot of these profiles; this one is of the \
                same class, Brake";
    let daemon = held(&robot, &journal, &[told]);
    assert_eq!(clear(&robot, &daemon), ["port: active", "right: active"]);
}

#[test]
fn one_that_the_profiles_name_as_an_actuator_holds_nobody_else() {
    let (robot, journal) = latched();
    robot.profiles.replace("app.xml", ">left<", ">port<");
    robot.profiles.replace("system.xml", "\"left\"", "\"port\"");
    let daemon = held(&robot, &journal, &[]);
    daemon.wait_for("left was an actuator when the emergency stop was raised, and is no slot of these profiles");
    assert_eq!(clear(&robot, &daemon), ["port: active", "right: active"]);
}

#[test]
fn where_nobody_knows_who_it_is_now_all_wait_for_the_operator() {
    let (robot, journal) = latched();
    let file = robot.lines.path().join("state/journal.jsonl.emergency");
    // As if it had been of a class that is no slot's any more.
    fs::write(&file, fs::read_to_string(&file).unwrap().replace("\"Brake\"", "\"Wheel\"")).unwrap();
    robot.profiles.replace("app.xml", ">left<", ">port<");
    robot.profiles.replace("system.xml", "<actuator component=\"left\"/>", "");
    let told = ["sensor", "idle", "port"].map(|slot| {
        format!("{slot}: left was an actuator when the emergency stop was raised, and is no slot of these profiles; nobody knows")
    });
    let mut daemon = held(&robot, &journal, &told.each_ref().map(String::as_str));
    for slot in ["idle", "port"] {
        assert_eq!(ask(&daemon, &format!("component start {slot}")).code, Some(7));
    }
    let all = ["sensor: active", "idle: active", "port: active", "right: active"];
    assert_eq!(clear(&robot, &daemon), all);
    daemon.stop();
    // From now on the latch is this run's, with its own actuators.
    let again = ["--inject", "sensor:crash.segv@0.3"];
    let mut daemon = Running::spawn_on(&journal, robot.profiles.path(), &again).ready();
    daemon.wait_for("EMERGENCY STOP for a fault of sensor");
    daemon.stop();
    let daemon = Running::spawn_on(&journal, robot.profiles.path(), &[]).ready();
    daemon.wait_for("port, right (held: emergency stop)");
    assert!(!ask(&daemon, "status").out.contains("held besides: "), "{}", daemon.log());
}

#[test]
fn where_there_was_none_it_says_that_it_holds_nobody() {
    let (robot, journal) = latched();
    fs::write(robot.lines.path().join("state/journal.jsonl.emergency"), "").unwrap();
    let nobody = self::robot("", "");
    nobody.profiles.write("system.xml", "<system_profile><name>s</name></system_profile>");
    let daemon = Running::spawn_on(&journal, nobody.profiles.path(), &[]).ready();
    assert!(ask(&daemon, "status").out.contains("no slot of these profiles is an actuator"), "{}", daemon.log());
}
