//! Devices that are lost and found again: one fault from the loss to the end of it, answered by the slot's rules.

use std::path::PathBuf;

use serde_json::Value;
use tempfile::TempDir;
use tests::asking::ask;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

/// A driver of files that are there or not.
struct Rig {
    profiles: Profiles,
    place: TempDir,
}

impl Rig {
    /// A driver `rover` with these devices, all there, which looks after them in that way; with rules, and other slots.
    fn new(devices: &[&str], by: &str, rules: &str, others: &[String]) -> Self {
        let place = TempDir::new().unwrap();
        let paths: Vec<_> = devices.iter().map(|name| place.path().join(name)).collect();
        let texts: Vec<_> = paths.iter().map(|path| path.display().to_string()).collect();
        let properties = format!(
            "<properties><property name=\"devices\" type=\"string\">{}</property>\
             <property name=\"by\" type=\"string\">{by}</property></properties>",
            texts.join(" ")
        );
        let rules = format!("<fault_tolerance>{rules}</fault_tolerance>");
        let rover = slot("rover", "Driver", &(properties + &rules));
        let profiles = Profiles::new(&application(&[&[rover], others].concat(), &[]));
        profiles.describe(&plugin_dir().join("libsignals.so"));
        let rig = Self { profiles, place };
        devices.iter().for_each(|device| rig.plug_in(device));
        rig
    }

    fn path(&self, device: &str) -> PathBuf {
        self.place.path().join(device)
    }

    fn plug_in(&self, device: &str) {
        std::fs::write(self.path(device), "").unwrap();
    }

    fn unplug(&self, device: &str) {
        std::fs::remove_file(self.path(device)).unwrap();
    }

    fn start(&self) -> Running {
        Running::start(self.profiles.path(), &[])
    }
}

fn texts<'a>(entries: &'a [Value], name: &str) -> Vec<&'a str> {
    entries.iter().map(|entry| entry[name].as_str().unwrap_or("-")).collect()
}

fn state(daemon: &Running, slot: &str) -> String {
    let asked = ask(daemon, &format!("component info {slot} --format json"));
    asked.json()[0]["component"]["state"].as_str().unwrap_or_default().to_owned()
}

/// The devices of the rover that are lost, as `component info` tells.
fn lost(daemon: &Running) -> Vec<String> {
    let asked = ask(daemon, "component info rover --format json").json().remove(0);
    let lost = asked["component"]["lost_devices"].as_array().cloned().unwrap_or_default();
    lost.iter().map(|lost| lost["device"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn a_lost_device_is_one_fault_until_it_is_found() {
    // A severity for all else says nothing about devices: no reset brings one back.
    let rig = Rig::new(&["left", "right"], "callback", "<severity>reset</severity>", &[]);
    let daemon = rig.start();
    rig.unplug("left");
    let fault = daemon.journal("fault", 1).remove(0);
    let path = rig.path("left").display().to_string();
    assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("rover"), Some("device")), "{fault}");
    assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("ignore"), Some("ignored")), "{fault}");
    let evidence = &fault["evidence"];
    assert_eq!((evidence["kind"].as_str(), evidence["device"].as_str()), (Some("device"), Some(path.as_str())));
    assert_eq!(evidence["os_error"].as_i64(), Some(2), "{evidence}");
    assert!(evidence["message"].as_str().unwrap().contains("No such file"), "{evidence}");
    daemon.wait_for(&format!("slot rover (Driver): device: {path} is lost: No such file"));
    daemon.until("the lost device", || lost(&daemon) == [path.clone()]);
    let shown = ask(&daemon, "status").out;
    assert!(shown.lines().any(|line| line.starts_with(&format!("slot rover: {path} is lost, for "))), "{shown}");
    assert!(ask(&daemon, "component info rover").out.contains("lost devices"));

    // The other one is a fault of its own, and each heals by itself.
    rig.unplug("right");
    let faults = daemon.journal("fault", 2);
    daemon.until("both devices", || lost(&daemon).len() == 2);
    rig.plug_in("left");
    let healed = daemon.journal("healed", 1).remove(0);
    assert_eq!(healed["evidence"]["device"], fault["evidence"]["device"]);
    assert!(healed["evidence"]["lost_ns"].as_u64() > Some(0) && healed["symptom"] == "device", "{healed}");
    daemon.wait_for(&format!("slot rover (Driver): device healed: {path} works again after "));
    rig.plug_in("right");
    let healed = daemon.journal("healed", 2);
    assert_eq!(healed[1]["evidence"]["device"], faults[1]["evidence"]["device"]);
    daemon.until("no lost device", || lost(&daemon).is_empty());
    assert_eq!(daemon.entries("fault").len(), 2, "each loss once, however often it is told");

    rig.unplug("left");
    assert_eq!(daemon.journal("fault", 3).len(), 3, "a new loss is a new fault");
}

#[test]
fn a_task_and_a_thread_of_its_own_tell_as_well() {
    for by in ["task", "thread"] {
        let rig = Rig::new(&["sonar"], by, "", &[]);
        let daemon = rig.start();
        rig.unplug("sonar");
        let fault = daemon.journal("fault", 1).remove(0);
        assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("rover"), Some("device")), "{by}");
        rig.plug_in("sonar");
        let _ = daemon.journal("healed", 1);
        assert_eq!(daemon.entries("fault").len(), 1, "{by}");
    }
}

#[test]
fn a_loss_that_outlasts_a_reset_is_answered_by_the_next_step() {
    let rules = "<severity symptom=\"device\">reset</severity><reset limit=\"2\" within=\"600s\"/>\
                 <secondary reference=\"Dummy.xml\" preload=\"instance\"/>";
    let rig = Rig::new(&["sonar"], "callback", rules, &[]);
    let daemon = rig.start();
    rig.unplug("sonar");
    let faults = daemon.journal("fault", 3);
    assert_eq!(texts(&faults, "symptom"), ["device"; 3]);
    assert_eq!(texts(&faults, "action"), ["reset", "reset", "replace"]);
    assert_eq!(texts(&faults, "outcome"), ["recovered"; 3]);
    assert_eq!(faults[2]["successor"], "Dummy");
    daemon.wait_for(&format!("rover: told of device: {}", rig.path("sonar").display()));
    // Who needs no device says nothing of it: it is lost still.
    assert_eq!((state(&daemon, "rover").as_str(), lost(&daemon).len()), ("active", 1));
}

#[test]
fn a_device_that_is_back_after_a_stop_heals_when_the_slot_is_reset() {
    let rig = Rig::new(&["sonar"], "callback", "<severity symptom=\"device\">stop</severity>", &[]);
    let daemon = rig.start();
    rig.unplug("sonar");
    assert_eq!(texts(&daemon.journal("fault", 1), "outcome"), ["stopped"]);
    daemon.until("the slot to stop", || state(&daemon, "rover") == "error");
    // Still unplugged: it stops again.
    let _ = ask(&daemon, "component reset rover");
    assert_eq!(texts(&daemon.journal("fault", 2), "outcome"), ["stopped"; 2]);
    rig.plug_in("sonar");
    daemon.until("the slot to work", || {
        let _ = ask(&daemon, "component reset rover");
        state(&daemon, "rover") == "active"
    });
    let _ = daemon.journal("healed", 1);
    daemon.until("no lost device", || lost(&daemon).is_empty());
    assert_eq!(daemon.entries("fault").len(), 2);
}

#[test]
fn a_lost_device_may_be_an_emergency() {
    let brakes = TempDir::new().unwrap();
    let line = brakes.path().join("line");
    let property =
        format!("<properties><property name=\"line\" type=\"string\">{}</property></properties>", line.display());
    let rules = "<severity symptom=\"device\">emergency</severity>";
    let rig = Rig::new(&["sonar"], "callback", rules, &[slot("brake", "Brake", &property)]);
    rig.profiles.describe(&plugin_dir().join("libhostile.so"));
    rig.profiles.write(
        "system.xml",
        "<system_profile><name>robot</name><emergency><actuator component=\"brake\"/></emergency></system_profile>",
    );
    let daemon = rig.start();
    rig.unplug("sonar");
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["symptom"].as_str(), fault["action"].as_str()), (Some("device"), Some("emergency")), "{fault}");
    daemon.until("the actuator to stop", || daemon.entries("emergency").len() >= 2);
    let raised = daemon.entries("emergency").remove(0);
    assert_eq!((&raised["root"], raised["outputs"].as_u64()), (&fault["seq"], Some(1)), "{raised}");
    let written = std::fs::read_to_string(&line).unwrap();
    assert!(written.lines().any(|line| line == "stop"), "{written}");
}
