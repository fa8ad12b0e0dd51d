//! Redundant sensors are voted over: who disagrees or falls silent is blamed, and the reader gets what most measured.

use serde_json::Value;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

/// Three sonars that measure as these scripts say, rules of each, a voter and an ear at it.
fn sonars(scripts: [&str; 3], rules: &str, voting: &str) -> Profiles {
    let sonar = |(name, script): (&str, &str)| {
        let properties =
            format!("<properties><property name=\"script\" type=\"std::string\">{script}</property></properties>");
        slot(name, "Wave", &format!("{properties}<fault_tolerance>{rules}</fault_tolerance>"))
    };
    let mut slots: Vec<String> = ["left", "middle", "right"].into_iter().zip(scripts).map(sonar).collect();
    slots.push(slot("ear", "Ear", ""));
    let text = application(&slots, &["sonar.out -> ear.heard"]);
    let voting = format!(
        "<voting name=\"sonar\" inputs=\"left middle right\" field=\"distance\" {voting}/>\n</application_profile>"
    );
    let profiles = Profiles::new(&text.replace("</application_profile>", &voting));
    profiles.describe(&plugin_dir().join("libsignals.so"));
    profiles
}

fn heard(daemon: &Running) -> Vec<f64> {
    let lines = daemon.lines("distance ");
    lines.iter().filter_map(|line| line.rsplit("distance ").next()?.trim().parse().ok()).collect()
}

fn of<'a>(entries: &'a [Value], name: &str) -> Vec<&'a str> {
    entries.iter().map(|entry| entry[name].as_str().unwrap_or("-")).collect()
}

#[test]
fn a_sonar_that_drifts_away_is_outvoted_once_and_the_reader_never_hears_it() {
    for method in ["median", "majority", "weighted"] {
        let drift = "100x40 101x20 103x20 106x20 120x20 180";
        let profiles = sonars(["100", "101", drift], "", &format!("method=\"{method}\" tolerance=\"5\""));
        let mut daemon = Running::start(profiles.path(), &[]);
        let fault = daemon.journal("fault", 1).remove(0);
        assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("right"), Some("vote")), "{method}");
        let evidence = &fault["evidence"];
        assert_eq!((evidence["kind"].as_str(), evidence["port"].as_str()), (Some("vote"), Some("right.out")));
        assert_eq!((evidence["field"].as_str(), evidence["agreeing"].as_u64()), (Some("distance"), Some(2)));
        assert!(evidence["value"].as_f64() >= Some(106.0) && evidence["agreed"].as_f64() <= Some(101.0), "{evidence}");
        daemon.wait_for("slot right (Wave): vote: right.out, field distance: ");
        daemon.wait_for_lines("distance ", 20);
        assert!(heard(&daemon).iter().all(|distance| (99.0..=105.0).contains(distance)), "{:?}", heard(&daemon));
        daemon.stop();
        assert_eq!(daemon.entries("fault").len(), 1, "{method}: as long as it is wrong it is one fault");
    }
}

#[test]
fn one_fails_and_one_drifts_and_where_no_two_agree_nothing_is_handed_on() {
    let profiles = sonars(["100", "100x60 -", "100x400 150"], "", "tolerance=\"5\" max_age=\"1s\"");
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    assert_eq!((of(&faults, "slot"), of(&faults, "symptom")), (vec!["middle", "sonar"], vec!["stale", "vote"]));
    let (silent, few) = (&faults[0]["evidence"], &faults[1]["evidence"]);
    assert_eq!((silent["kind"].as_str(), silent["port"].as_str()), (Some("silence"), Some("middle.out")));
    assert!(silent["silent_ns"].as_u64() > Some(1_000_000_000), "{silent}");
    assert_eq!((few["kind"].as_str(), few["port"].as_str()), (Some("quorum"), Some("sonar.out")));
    assert_eq!(
        (few["agreeing"].as_u64(), few["require"].as_u64(), few["members"].as_u64()),
        (Some(1), Some(2), Some(3))
    );
    assert_eq!(faults[1]["outcome"], "ignored", "there is no instance that could be reset");
    daemon.wait_for("slot sonar (voting): vote: sonar.out, field distance: 1 of 3 agree, 2 must");
    // Of two that disagree nobody knows who is right.
    daemon.stop();
    assert!(heard(&daemon).iter().all(|distance| *distance == 100.0), "{:?}", heard(&daemon));
    assert_eq!(daemon.entries("fault").len(), 2);
}

#[test]
fn all_of_them_fall_silent_at_once_and_the_voter_tells_of_it_once_and_of_the_end() {
    // Nobody is left in whose callback it could be voted. Where the voter has no age of its own, only the loss is told.
    for (age, stale) in [("max_age=\"1s\"", 3), ("", 0)] {
        let profiles = sonars(["7x60 -x400 7"; 3], "", &format!("tolerance=\"1\" {age}"));
        let mut daemon = Running::start(profiles.path(), &[]);
        let of_voter = |kind: &str| -> Vec<Value> {
            daemon.entries(kind).into_iter().filter(|entry| entry["slot"] == "sonar").collect()
        };
        daemon.until("the voter has its members again", || !of_voter("healed").is_empty());
        let lost = of_voter("fault").remove(0);
        assert_eq!((lost["symptom"].as_str(), lost["class"].as_str()), (Some("vote"), Some("voting")), "{lost}");
        let evidence = &lost["evidence"];
        assert_eq!((evidence["kind"].as_str(), evidence["require"].as_u64()), (Some("quorum"), Some(2)), "{evidence}");
        assert!(evidence["agreeing"].as_u64() < Some(2), "one falls silent a moment before the next: {evidence}");
        let before = heard(&daemon).len();
        daemon.wait_for_lines("distance ", before + 5);
        daemon.stop();
        assert_eq!(daemon.entries("fault").iter().filter(|fault| fault["symptom"] == "stale").count(), stale, "{age}");
        assert_eq!((daemon.entries("fault").len(), daemon.entries("healed").len()), (stale + 1, stale + 1), "{age}");
    }
}

#[test]
fn members_that_never_say_a_word_are_missed_as_well() {
    let profiles = sonars(["-"; 3], "", "tolerance=\"1\" max_age=\"200ms\"");
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 4);
    let mut slots = of(&faults, "slot");
    slots.sort_unstable();
    assert_eq!(slots, ["left", "middle", "right", "sonar"]);
    daemon.stop();
    assert_eq!(daemon.entries("fault").len(), 4);
}

#[test]
fn who_agrees_again_is_healed_and_the_rules_of_the_outvoted_answer() {
    let rules = "<severity symptom=\"vote\">reset</severity><reset limit=\"100\" within=\"1s\"/>";
    let profiles = sonars(["7", "7", "7x100 90x20 7"], rules, "tolerance=\"1\"");
    let daemon = Running::start(profiles.path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["slot"].as_str(), fault["action"].as_str()), (Some("right"), Some("reset")));
    assert_eq!(fault["outcome"], "recovered");
    daemon.wait_for("slot right (Wave): vote: right.out");

    let profiles = sonars(["7", "7", "7x100 90x20 7"], "", "tolerance=\"1\"");
    let daemon = Running::start(profiles.path(), &[]);
    let healed = daemon.journal("healed", 1).remove(0);
    assert_eq!((healed["slot"].as_str(), healed["symptom"].as_str()), (Some("right"), Some("vote")));
    assert_eq!(daemon.entries("fault").len(), 1);
}

#[test]
fn what_a_reader_finds_wrong_with_the_winner_is_the_winners_fault() {
    let profiles = sonars(["400", "400", "400"], "", "");
    profiles.replace(
        "Ear.xml",
        "<usage>input</usage>",
        "<usage>input</usage><validity field=\"distance\"><max>300</max></validity>",
    );
    let mut daemon = Running::start(profiles.path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!(fault["symptom"], "validity");
    assert!(["left", "middle", "right"].contains(&fault["slot"].as_str().unwrap()), "{fault}");
    daemon.stop();
    assert_eq!(heard(&daemon), [] as [f64; 0]);
}

#[test]
fn a_voter_is_seen_and_connected_as_a_slot_is() {
    let profiles = sonars(["1", "1", "1"], "", "");
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for_lines("distance ", 1);
    let ask = |words: &str| {
        let answer = tests::asking::ask(&daemon, words);
        assert_eq!(answer.code, Some(0), "{answer:?}");
        answer.json()
    };
    let listed = ask("port list --format json");
    let voter = listed.iter().find(|port| port["slot"] == "sonar").expect("the voter's port is listed");
    assert_eq!((voter["port"].as_str(), voter["direction"].as_str()), (Some("out"), Some("voter")));
    assert_eq!(voter["connections"], serde_json::json!(["ear.heard"]));
    assert_eq!(voter["voters"], serde_json::json!(["left.out", "middle.out", "right.out"]));
    let left = listed.iter().find(|port| port["slot"] == "left").unwrap();
    assert_eq!(left["heard_by"], serde_json::json!(["sonar"]));
    let status = ask("status --format json").remove(0);
    let helper = &status["helpers"][0];
    assert_eq!((helper["helper"].as_str(), helper["kind"].as_str()), (Some("sonar"), Some("voter")));
    assert!(helper["votes"].as_u64() > Some(0) && helper["agreeing"].as_array().unwrap().len() == 3, "{helper}");
    let info = ask("port info sonar.out --format json").remove(0);
    assert_eq!(info["layout"]["name"], "Reading");
    let echoed = ask("port echo sonar.out --count 1 --format json").remove(0);
    assert_eq!(echoed["echo"]["value"]["distance"], 1.0);
    // By name, as any other writer.
    let wire = |words: &str| assert_eq!(tests::asking::ask(&daemon, words).code, Some(0));
    wire("disconnect ear.heard");
    wire("connect sonar.out ear.heard");
    let before = heard(&daemon).len();
    daemon.wait_for_lines("distance ", before + 2);
}
