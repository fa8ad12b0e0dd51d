//! What an operator may have done while the emergency stop is latched, where a voter is among those that raise it.

use serde_json::json;
use tempfile::TempDir;
use tests::asking::ask;
use tests::running::Running;
use tests::sonars::{SONARS, line, of, state, voter, with_brakes};

/// Ended by nothing that it could answer, with what it says of its emergency stop on the disk.
fn killed(mut daemon: Running) {
    let file = daemon.journal_file().with_extension("jsonl.emergency");
    let is_kept = || std::fs::read_to_string(&file).is_ok_and(|text| text.contains("vote"));
    daemon.until("the latch is kept", is_kept);
    daemon.signal("KILL");
    daemon.wait();
}

#[test]
fn after_a_restart_it_is_not_taken_back_before_the_voter_has_voted() {
    let place = TempDir::new().unwrap();
    let profiles = with_brakes(["7"; 3], &place);
    let journal = place.path().join("journal.jsonl");
    let daemon = Running::spawn_on(&journal, profiles.path(), &[]).ready();
    for slot in ["left", "middle"] {
        assert_eq!(ask(&daemon, &format!("component stop {slot}")).code, Some(0));
    }
    daemon.until("the emergency stop", || daemon.entries("emergency").len() >= 3);
    killed(daemon);
    // From now on they wait for somebody who starts them, and the voter for them, longer than this test takes.
    profiles.replace(
        "Wave.xml",
        "</execution_semantics>",
        "<lifecycle_type>none</lifecycle_type></execution_semantics>",
    );
    profiles.replace("app.xml", "max_age=\"300ms\"", "max_age=\"300s\"");
    let daemon = Running::spawn_on(&journal, profiles.path(), &[]).ready();
    let refused = ask(&daemon, "fault clear");
    assert_eq!(refused.code, Some(6), "{refused:?}");
    assert!(refused.err.contains("the voter `sonar` has not heard that yet in this run"), "{refused:?}");
    assert_eq!((&voter(&daemon)["falls_short"], &voter(&daemon)["agrees"]), (&json!(false), &json!(false)));
    assert!(ask(&daemon, "status").out.contains("they have not agreed yet"));
    for slot in SONARS {
        assert_eq!(ask(&daemon, &format!("component start {slot}")).out, format!("{slot}: active\n"));
    }
    daemon.until("they agree", || voter(&daemon)["agrees"] == true);
    assert_ne!(line(&place, "wheels").last().map(String::as_str), Some("drive"));
    let cleared = ask(&daemon, "fault clear");
    assert!(cleared.out.ends_with("is cleared\nwheels: active\narm: active\n"), "{cleared:?}");
}

#[test]
fn all_members_of_a_voter_are_reset_while_it_is_latched_though_two_of_them_agree() {
    let place = TempDir::new().unwrap();
    let profiles = with_brakes(["7"; 3], &place);
    let faults = SONARS.map(|slot| ["--inject".to_owned(), format!("{slot}:crash.segv@0.4")]).concat();
    let daemon = Running::start(profiles.path(), &faults.iter().map(String::as_str).collect::<Vec<_>>());
    daemon.until("the emergency stop", || daemon.entries("emergency").len() >= 3);
    daemon.until("all are dead", || SONARS.iter().all(|slot| state(&daemon, slot).0 == "error"));
    for slot in ["left", "middle"] {
        assert_eq!(ask(&daemon, &format!("component reset {slot}")).out, format!("{slot}: active\n"));
    }
    daemon.until("two agree", || !of(&daemon, "healed", "sonar").is_empty());
    assert_eq!(ask(&daemon, "component reset right").out, "right: active\n");
    // It hears all now: what is stopped by hand is started, but nothing else.
    assert_eq!(ask(&daemon, "component start wheels").code, Some(7));
    assert_eq!(ask(&daemon, "component reset right").code, Some(7));
    assert_eq!(ask(&daemon, "component stop right").code, Some(0));
    assert_eq!(ask(&daemon, "component start right").out, "right: active\n");
    let cleared = ask(&daemon, "fault clear");
    assert!(cleared.out.ends_with("is cleared\nwheels: active\narm: active\n"), "{cleared:?}");
}
