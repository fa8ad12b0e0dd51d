//! What no level inside one process contains, each as the README's table "What is left" tells it, and what happens then.

use std::os::unix::net::UnixStream;
use std::os::unix::process::ExitStatusExt;

use serde_json::Value;
use tests::culprit::{self, beside, doer, the_other_goes_on};
use tests::profiles::{Profiles, application, plugin_dir};
use tests::running::Running;

fn daemon(doers: &[String]) -> (Profiles, Running) {
    let profiles = beside(doers);
    let daemon = Running::start(profiles.path(), &[]);
    (profiles, daemon)
}

/// The daemon ends by that signal, maybe before it is ready.
fn ends_by(deed: &str, signal: i32) -> Running {
    let profiles = culprit::alone(deed);
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().signal(), Some(signal), "the log:\n{}", daemon.log());
    daemon
}

fn alone(deed: &str) -> (Profiles, Running) {
    daemon(&[doer("culprit", deed, "")])
}

fn of<'a>(faults: &'a [Value], field: &str) -> Vec<&'a str> {
    faults.iter().map(|fault| fault[field].as_str().unwrap_or_default()).collect()
}

/// The successors of who failed under that lock hang on it; the watchdog ends them, and the ladder comes to its end.
fn hangs_on_what_was_left(deed: &str) {
    let (_profiles, mut daemon) = alone(deed);
    daemon.wait_for("the slot is stopped");
    let faults = daemon.journal("fault", 3);
    assert_eq!(of(&faults, "symptom"), ["crash.segv", "hang", "hang"], "{deed}");
    assert_eq!(of(&faults, "action"), ["reset", "reset", "stop"], "{deed}");
    the_other_goes_on(&mut daemon);
}

#[test]
fn a_lock_of_its_own_that_a_component_held_stays_locked() {
    hangs_on_what_was_left("static lock");
}

#[test]
fn a_lock_of_the_c_library_that_a_thread_held_stays_locked() {
    hangs_on_what_was_left("stdio lock");
}

#[test]
fn the_address_of_a_thread_local_that_was_kept_across_a_wait_is_stale() {
    let here = "<executor>main</executor>";
    let profiles = Profiles::new(&application(
        &[doer("keeper", "thread-local kept", here), doer("culprit", "stdio lock", here)],
        &[],
    ));
    profiles.describe(&plugin_dir().join("libshielded.so"));
    profiles.executors(&["main"]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("its thread-local is elsewhere, and what it kept still says 7");
    let _ = daemon.stop();
    assert!(daemon.entries("fault").iter().all(|fault| fault["slot"] == "culprit"));
}

#[test]
fn an_uninterruptible_system_call_holds_its_executor_up_and_no_other() {
    let (_profiles, mut daemon) = alone("uninterruptible");
    let faults = daemon.journal("fault", 1);
    assert_eq!((&faults[0]["slot"], &faults[0]["symptom"]), (&"culprit".into(), &"hang".into()));
    // Found after a second, ended when the call was over.
    let detected_ns = faults[0]["times"]["detected_ns"].as_u64();
    assert!(detected_ns > Some(1_500_000_000), "{}", faults[0]);
    the_other_goes_on(&mut daemon);
}

#[test]
fn a_cloned_thread_that_fails_later_ends_the_daemon() {
    let daemon = ends_by("clone null later", libc::SIGSEGV);
    assert_eq!(daemon.entries("crash").len(), 1, "with its last words");
}

#[test]
fn a_child_keeps_the_control_socket_open() {
    let (_profiles, mut daemon) = alone("child that stays");
    daemon.wait_for_lines("is over: child that stays", 1);
    daemon.signal("KILL");
    assert_eq!(daemon.wait().signal(), Some(libc::SIGKILL));
    UnixStream::connect(daemon.socket()).expect("somebody listens");
}

#[test]
fn what_components_write_to_descriptors_of_the_daemon_is_written() {
    let (_profiles, mut daemon) = alone("write everywhere");
    let journal = daemon.journal_file().to_owned();
    let text = || std::fs::read_to_string(&journal).unwrap_or_default();
    daemon.until("nonsense in the journal", || text().contains("nonsense"));
    assert!(daemon.is_alive());
}

#[test]
fn descriptors_of_other_components_are_closed() {
    let (_profiles, mut daemon) = daemon(&[doer("owner", "own device", ""), doer("culprit", "close others", "")]);
    let faults = daemon.journal("fault", 1);
    assert_eq!((&faults[0]["slot"], &faults[0]["symptom"]), (&"owner".into(), &"error".into()), "it is blamed");
    the_other_goes_on(&mut daemon);
}

#[test]
fn a_fatal_signal_that_names_the_process_by_a_descriptor_ends_it() {
    ends_by("pidfd kill", libc::SIGKILL);
}

#[cfg(target_arch = "x86_64")]
#[test]
fn who_moves_the_thread_locals_away_ends_the_daemon() {
    ends_by("thread base", libc::SIGSEGV);
}

#[test]
fn a_wild_write_that_does_not_trap_is_found_by_nobody() {
    let (_profiles, mut daemon) = daemon(&[doer("owner", "own value", ""), doer("culprit", "wild write", "")]);
    daemon.wait_for("its own value is 8");
    assert!(daemon.entries("fault").is_empty());
    the_other_goes_on(&mut daemon);
}
