//! Starting and ending: the ready line, exit codes, signals, the order of callbacks.

use tests::profiles::{Profiles, application, slot};
use tests::running::Running;

#[test]
fn it_says_when_it_is_ready_and_ends_in_order() {
    let profiles = Profiles::new(&application(&[slot("diary", "Diary", "")], &[]));
    let mut daemon = Running::start(profiles.path(), &[]);
    assert!(daemon.log().contains("ready: 1 slots on 1 executors: diary"));
    daemon.wait_for("hook update");
    daemon.stop();
    let hooks: Vec<String> =
        daemon.lines("hook ").iter().map(|line| line.rsplit("hook ").next().unwrap_or_default().to_owned()).collect();
    assert_eq!(hooks, ["initialize", "start", "execute", "update", "stop", "destroy"]);
}

#[test]
fn an_invalid_profile_is_exit_3_with_line_and_column() {
    let profiles = Profiles::new(&application(&[slot("a", "Missing", "")], &[]));
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(3));
    daemon.wait_for("app.xml:4:");
    let start = daemon.entries("start").remove(0);
    assert_eq!(start["accepted"], false);
    assert!(start["reasons"][0].as_str().unwrap().contains("app.xml:4:"), "{start}");
}

#[test]
fn a_missing_plugin_is_exit_4_and_says_where_it_was_looked_for() {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", "")], &[]));
    profiles.replace("Ticker.xml", "libbasic.so", "libnowhere.so");
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(4));
    daemon.wait_for("no plugin for library_name `libnowhere.so`");
}

#[test]
fn a_property_out_of_range_is_refused_with_its_range() {
    let inside = "<properties><property name=\"first\" type=\"int\">-1</property></properties>";
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", inside)], &[]));
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(1));
    daemon.wait_for("`first`");
}

#[test]
fn a_component_that_does_not_stop_is_ended() {
    let profiles = Profiles::new(&application(&[slot("stubborn", "Stubborn", ""), slot("diary", "Diary", "")], &[]));
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.stop();
    daemon.wait_for("slot stubborn (Stubborn): hang");
    daemon.wait_for("hook destroy");
}

#[test]
fn a_second_signal_leaves_at_once() {
    let slots: Vec<String> = (0..40).map(|number| slot(&format!("stubborn{number}"), "Stubborn", "")).collect();
    let profiles = Profiles::new(&application(&slots, &[]));
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.signal("INT");
    daemon.wait_for("(Stubborn): hang");
    daemon.signal("INT");
    assert!(!daemon.wait().success());
    assert!(daemon.lines("(Stubborn): hang").len() < 40);
}

#[test]
fn an_unknown_slot_to_inject_into_is_wrong_usage() {
    let profiles = Profiles::new(&application(&[slot("diary", "Diary", "")], &[]));
    let mut daemon = Running::spawn(profiles.path(), &["--inject", "dairy:crash.segv@1"]);
    assert_eq!(daemon.wait().code(), Some(2));
    daemon.wait_for("there is no slot `dairy`; there are: diary");
}
