//! Signals that go wrong are found at the ports: silence, jumps, limits that depend on other fields.

use serde_json::Value;
use tests::profiles::{Profiles, application, connection, plugin_dir, slot};
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

/// What is found of a wave by a `<validity>` at its connection.
fn checked(script: &str, rules: &str, validity: &str) -> Profiles {
    let wire = connection("wave.out -> ear.heard", validity);
    let slots = [wave(script, rules), slot("ear", "Ear", "")];
    let profiles = Profiles::new(&application(&slots, &[&wire]));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles
}

#[test]
fn a_limit_may_depend_on_another_field_of_the_same_object() {
    // A robot at a speed of 2 needs 11 of distance, one at rest 10.
    let limit = "<validity field=\"distance\"><min slope=\"0.5\" of=\"speed\" offset=\"10\"/></validity>";
    let profiles = checked("10.5x40 10.5/2x3 11/2x40 9x3 ...", "", limit);
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    let found = |fault: &Value| {
        let evidence = &fault["evidence"];
        (evidence["value"].as_f64(), evidence["limit"].as_f64(), evidence["field"].as_str().map(str::to_owned))
    };
    let distance = Some("distance".to_owned());
    assert_eq!(found(&faults[0]), (Some(10.5), Some(11.0), distance.clone()));
    assert_eq!(found(&faults[1]), (Some(9.0), Some(10.0), distance));
    assert_eq!(texts(&faults[..2], "symptom"), ["validity", "validity"]);
    let _ = daemon.journal("healed", 1);
    daemon.wait_for("validity: heard, field distance: 10.5, limit 11;");
}

#[test]
fn a_value_that_jumps_is_found_by_its_rate() {
    // 5 ms apart, give or take: a step of 1 is a rate of 200, a step of 100 one of 20,000.
    let profiles =
        checked("1x40 2x40 101x40 ...", "", "<validity field=\"distance\"><max_rate>3000</max_rate></validity>");
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    assert_eq!(texts(&faults[..2], "symptom"), ["rate", "rate"]);
    for fault in &faults[..2] {
        assert!(fault["evidence"]["value"].as_f64() > Some(3000.0) && fault["evidence"]["limit"] == 3000.0, "{fault}");
    }
    let _ = daemon.journal("healed", 2);
}

#[test]
fn what_is_no_number_is_never_valid_and_each_element_is_checked() {
    let profiles = checked("1x40 NaN 1x40 7 ...", "", "<validity field=\"echoes\"><max>5</max></validity>");
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    assert_eq!((&faults[0]["evidence"]["field"], &faults[0]["evidence"]["value"]), (&"echoes[2]".into(), &Value::Null));
    assert_eq!(
        (&faults[1]["evidence"]["field"], faults[1]["evidence"]["value"].as_f64()),
        (&"echoes[2]".into(), Some(7.0))
    );
}

#[test]
fn a_value_that_comes_and_goes_within_its_delay_is_one_fault() {
    let validity = "<validity field=\"distance\" delay=\"100ms\"><max>5</max><on_invalid>hold</on_invalid></validity>";
    // Two bad ones among good ones are nothing; bad ones for long are a fault; good ones in between are not the end of it.
    let profiles = checked("1x40 9x2 1x40 9x100 1x2 9x100 1", "", validity);
    let mut daemon = Running::start(profiles.path(), &[]);
    let _ = daemon.journal("cleared", 1);
    daemon.stop();
    let count = |kind: &str| daemon.entries(kind).len();
    assert_eq!((count("fault"), count("healed"), count("cleared")), (1, 1, 1));
    let at = |kind: &str| daemon.entries(kind)[0]["mono_ns"].as_u64().unwrap();
    assert!(at("fault") < at("healed") && at("healed") < at("cleared"));
}

/// A wave, and a monitor of one of its ends.
fn monitored(script: &str, rules: &str, monitor: &str, wires: &[&str]) -> Profiles {
    let text = application(&[wave(script, rules), slot("ear", "Ear", "")], wires);
    let profiles = Profiles::new(&text.replace("</application_profile>", &format!("{monitor}</application_profile>")));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles
}

const WATCH_THE_WAVE: &str = "<monitor component=\"wave\" port=\"out\"><validity field=\"distance\"><min>3</min><max>300</max>\
     </validity><max_age>100ms</max_age></monitor>";

#[test]
fn a_monitor_finds_what_is_wrong_at_a_port_and_readers_get_everything() {
    let profiles = monitored("5x40 0x40 5x40 -x100 ...", "", WATCH_THE_WAVE, &["wave.out -> ear.heard"]);
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    assert_eq!(texts(&faults[..2], "symptom"), ["validity", "stale"]);
    assert_eq!(texts(&faults[..2], "slot"), ["wave", "wave"]);
    let port = |fault: &Value| fault["evidence"]["port"].as_str().map(str::to_owned);
    assert!(faults[..2].iter().all(|fault| port(fault).as_deref() == Some("monitor of wave.out")), "{faults:?}");
    assert_eq!(faults[0]["evidence"]["value"], 0.0);
    // What it finds keeps nothing from anybody.
    daemon.wait_for("distance 0");
    daemon.wait_for("monitor of wave.out, field distance: 0, limit 3");
    daemon.wait_for("monitor of wave.out heard nothing for ");
    let info = ask(&daemon, &["port", "info", "wave.out"]);
    assert!(info.contains("monitor of wave.out"), "{info}");
    let healed = daemon.journal("healed", 2);
    assert_eq!(texts(&healed[..2], "symptom"), ["validity", "stale"]);
}

#[test]
fn a_monitor_needs_no_reader_and_its_finds_are_answered_by_the_rules_of_the_writer() {
    let rules = "<severity symptom=\"validity\">stop</severity>";
    let mut daemon = Running::start(monitored("5x40 0", rules, WATCH_THE_WAVE, &[]).path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["outcome"].as_str(), fault["symptom"].as_str()), (Some("stopped"), Some("validity")));
    daemon.stop();
}

#[test]
fn a_monitor_of_an_input_watches_what_is_sent_to_it_and_a_reload_takes_it_away() {
    let monitor = WATCH_THE_WAVE.replace("component=\"wave\" port=\"out\"", "component=\"ear\" port=\"heard\"");
    let profiles = monitored("5x20 0x20 ...", "", &monitor, &["wave.out -> ear.heard"]);
    let daemon = Running::start(profiles.path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!(
        (fault["slot"].as_str(), fault["evidence"]["port"].as_str()),
        (Some("wave"), Some("monitor of ear.heard"))
    );
    for format in ["dot", "mermaid", "svg"] {
        let output = std::process::Command::new(tests::daemon_binary::daemon_binary());
        let drawn = { output }.arg("graph").arg(profiles.path()).args(["--as", format]).output().unwrap();
        let drawn = String::from_utf8_lossy(&drawn.stdout).into_owned();
        assert!(drawn.contains("monitor: distance 3..300, not silent for 100ms"), "{drawn}");
    }
    profiles.replace("app.xml", &monitor, "");
    daemon.signal("HUP");
    daemon.wait_for("reloaded: ");
    let info = ask(&daemon, &["port", "info", "wave.out"]);
    assert!(!info.contains("monitor"), "{info}");
    // Nobody looks any more: the next bad values, a tenth of a second later at most, are nobody's fault.
    let before = daemon.entries("fault").len();
    std::thread::sleep(std::time::Duration::from_millis(600));
    assert!(daemon.entries("fault").len() <= before + 1, "one may have been on its way");
}

/// What a verb prints.
fn ask(daemon: &Running, verb: &[&str]) -> String {
    let mut command = std::process::Command::new(tests::daemon_binary::daemon_binary());
    let output = command.args(verb).arg("--socket").arg(daemon.socket()).output().expect("the daemon's binary runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn ends_that_do_not_fit_are_a_fault_of_the_wiring_and_both_are_named() {
    let slots = [wave("1", ""), slot("listener", "Listener", "")];
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    let daemon = Running::start(profiles.path(), &[]);
    let mut command = std::process::Command::new(tests::daemon_binary::daemon_binary());
    let command = command.args(["connect", "wave.out", "listener.heard"]).arg("--socket").arg(daemon.socket());
    assert!(!command.output().expect("the daemon's binary runs").status.success());
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("wave"), Some("type")));
    let said = fault["evidence"]["message"].as_str().unwrap();
    assert!(said.contains("wave.out carries Reading, listener.heard expects Count"), "{said}");
}
