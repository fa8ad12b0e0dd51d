//! What stands ready: spares, and what becomes of them.

use tests::profiles::{Profiles, application, connection, plugin_dir, slot};
use tests::running::Running;

/// One slot of the class that counts its instances, with these properties and rules.
fn heirs(properties: &[(&str, &str)], rules: &str) -> Profiles {
    let property = |(name, text): &(&str, &str)| format!("<property name=\"{name}\" type=\"string\">{text}</property>");
    let properties: String = properties.iter().map(property).collect();
    let inside = format!(
        "<properties>{properties}</properties><fault_tolerance><severity>reset</severity>{rules}</fault_tolerance>"
    );
    let profiles = Profiles::new(&application(&[slot("heir", "Heir", &inside)], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles
}

/// The numbers in the log's lines `heir N <word>`.
fn numbers(daemon: &Running, word: &str) -> Vec<u64> {
    let number = |line: &String| line.split("heir ").nth(1)?.strip_suffix(word)?.trim().parse().ok();
    daemon.lines(word).iter().filter_map(number).collect()
}

#[test]
fn spares_are_ready_before_the_first_fault_used_in_turn_and_made_anew() {
    let profiles = heirs(&[("from", "100"), ("until", "100")], "<spare count=\"2\"/>");
    let inject: Vec<String> = (2..6).flat_map(|at| ["--inject".into(), format!("heir:crash.segv@0.{at}")]).collect();
    let mut daemon = Running::start(profiles.path(), &inject.iter().map(String::as_str).collect::<Vec<_>>());
    daemon.wait_for_lines("is ready", 7);
    assert!(daemon.journal("fault", 4).iter().all(|fault| fault["outcome"] == "recovered"));
    let slots = daemon.stop();
    assert_eq!(numbers(&daemon, "succeeds"), [2, 3, 4, 5], "each in its turn, none made on the spot");
    assert_eq!(slots[0]["quarantined"], 4);
    let mut ended = numbers(&daemon, "ends");
    ended.sort_unstable();
    assert_eq!(ended, [5, 6, 7], "the spares that were left end in order");
}

#[test]
fn what_stands_ready_has_rehearsed_and_nobody_heard_it() {
    let rules = "<reset limit=\"0\"/><spare/><secondary reference=\"Heir.xml\"/>";
    let profiles = heirs(&[("from", "100"), ("until", "100")], rules);
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("gauge", "Gauge", "")));
    let wire = connection("heir.said -> gauge.heard", "<validity field=\"range\"><min>0</min></validity>");
    profiles.replace("app.xml", "</port_connections>", &format!("{wire}</port_connections>"));
    let mut daemon = Running::start(profiles.path(), &["--inject", "heir:crash.segv@0.2"]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("replace"), Some("recovered")));
    daemon.wait_for("heir 4 rehearses");
    daemon.stop();
    assert_eq!(daemon.entries("fault").len(), 1, "a rehearsal's values reach nobody");
    // The secondary, the primary's spare, and then the secondary's; the primary does not.
    let mut rehearsed = numbers(&daemon, "rehearses: Unconnected");
    rehearsed.sort_unstable();
    assert_eq!((rehearsed, numbers(&daemon, "succeeds")), (vec![2, 3, 4], vec![2]));
}

#[test]
fn one_spare_is_kept_where_a_reset_answers_a_crash_and_none_where_nothing_does() {
    let daemon = Running::start(heirs(&[("from", "100"), ("until", "100")], "").path(), &[]);
    daemon.wait_for_lines("is ready", 2);
    let profiles = heirs(&[("from", "100"), ("until", "100")], "");
    profiles.replace("app.xml", "<severity>reset</severity>", "");
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.stop();
    assert_eq!(numbers(&daemon, "is ready"), [1]);
}

#[test]
fn a_spare_that_cannot_be_made_is_journaled_and_tried_again_and_the_slot_works_on() {
    for how in ["panic", "segv", "error"] {
        let profiles = heirs(&[("how", how)], "<spare count=\"1\"/>");
        let mut daemon = Running::start(profiles.path(), &["--inject", "heir:crash.segv@0.6"]);
        let faults = daemon.journal("fault", 3);
        let field =
            |name: &str| faults.iter().map(|fault| fault[name].as_str().unwrap_or_default()).collect::<Vec<_>>();
        assert_eq!(field("action"), ["prepare", "prepare", "reset"], "{how}");
        assert_eq!(field("outcome"), ["failed", "failed", "recovered"], "{how}");
        daemon.wait_for("heir 4 succeeds");
        let slots = daemon.stop();
        assert_eq!((slots[0]["state"].as_str(), slots[0]["faults"].as_u64()), (Some("active"), Some(3)), "{how}");
    }
}

/// A slot whose secondaries all fail in `start`, so that each try of its recovery does.
fn hopeless() -> Profiles {
    let property = |name, text| format!("<property name=\"{name}\" type=\"string\">{text}</property>");
    let properties = format!("<properties>{}{}</properties>", property("hook", "start"), property("how", "segv"));
    let secondaries = "<secondary reference=\"Doomed.xml\" preload=\"library\"/>".repeat(12);
    let rules = format!("<fault_tolerance><severity>reset</severity>{secondaries}</fault_tolerance>");
    let profiles = Profiles::new(&application(&[slot("hopeless", "Doomed", &(properties + &rules))], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles
}

#[test]
fn a_stop_wins_over_a_recovery_that_breathes() {
    let profiles = hopeless();
    let mut daemon = Running::start(profiles.path(), &[]);
    // By now the pauses are longer than what a stop takes.
    let failed = daemon.journal("fault", 6);
    assert!(failed.iter().all(|fault| fault["outcome"] == "failed"));
    let slots = daemon.stop();
    let faults = daemon.entries("fault");
    let last = faults.last().unwrap();
    assert_eq!((last["symptom"].as_str(), last["outcome"].as_str()), (Some("crash.segv"), Some("stopped")));
    assert!(faults.len() < 14, "it did not try all that was left: {}", faults.len());
    assert_eq!(slots[0]["state"], "error");
}
