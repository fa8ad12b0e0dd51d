//! What once went wrong, one test each.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, application, connection, plugin_dir, slot};
use tests::running::Running;

const RESET: &str = "<fault_tolerance><severity>reset</severity><reset limit=\"50\" within=\"60s\"/></fault_tolerance>";

fn diary() -> Profiles {
    Profiles::new(&application(&[slot("diary", "Diary", RESET)], &[]))
}

/// Runs the daemon with these pipes, whose readers are gone or never read, through nine faults; then asks it to end.
fn run_unheard(stdout: Stdio, stderr: Stdio) -> (Option<i32>, String) {
    let (profiles, scratch) = (diary(), tempfile::tempdir().unwrap());
    let journal = scratch.path().join("journal.jsonl");
    let mut command = Command::new(daemon_binary());
    command.arg("run").arg(profiles.path()).arg("--plugins").arg(plugin_dir()).arg("--journal").arg(&journal);
    for number in 1..=9 {
        command.arg("--inject").arg(format!("diary:crash.segv@0.{number}"));
        command.arg("--inject").arg(format!("diary:crash.panic@0.{number}5"));
    }
    // A backtrace that somebody asked for must not be looked up on the way of a recovery.
    command.env("RUST_LOG", "trace").env("RUST_BACKTRACE", "full");
    let mut child = command.stdout(stdout).stderr(stderr).spawn().unwrap();
    // A pipe that was made by `Stdio::piped` is held by the child's handle and never read.
    let began = Instant::now();
    let faults = || std::fs::read_to_string(&journal).unwrap_or_default().matches("crash.segv").count();
    while faults() < 9 && began.elapsed() < Duration::from_secs(30) {
        std::thread::sleep(Duration::from_millis(10));
    }
    let killed = Command::new("kill").arg(child.id().to_string()).status().unwrap();
    assert!(killed.success(), "it ended by itself");
    let status = child.wait().unwrap();
    (status.code(), std::fs::read_to_string(journal).unwrap())
}

fn closed_pipe() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

#[test]
fn a_log_whose_reader_is_gone_does_not_end_the_daemon() {
    let (code, journal) = run_unheard(Stdio::null(), closed_pipe());
    assert_eq!(code, Some(0));
    assert_eq!(journal.matches("crash.segv").count(), 9);
    assert!(journal.contains("\"kind\":\"stop\""));
}

#[test]
fn output_whose_reader_is_gone_does_not_end_the_daemon() {
    let (code, journal) = run_unheard(closed_pipe(), Stdio::null());
    assert_eq!(code, Some(0));
    assert!(journal.contains("\"kind\":\"stop\""));
}

#[test]
fn a_log_that_nobody_reads_stops_nothing() {
    let (code, journal) = run_unheard(Stdio::null(), Stdio::piped());
    assert_eq!(code, Some(0));
    assert_eq!(journal.matches("crash.segv").count(), 9);
}

#[test]
fn a_signal_sent_from_outside_ends_the_daemon_by_that_signal() {
    use std::os::unix::process::ExitStatusExt;
    let profiles = diary();
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.signal("SEGV");
    assert_eq!(daemon.wait().signal(), Some(11));
}

fn sonar(bad_every: u32) -> Profiles {
    let inside = format!(
        "<properties><property name=\"bad_every\" type=\"int\">{bad_every}</property></properties><fault_tolerance>\
         <severity>reset</severity><reset limit=\"2\" within=\"60s\"/></fault_tolerance>"
    );
    let plain = application(&[slot("sonar", "Sonar", &inside), slot("gauge", "Gauge", "")], &[]);
    let wire = connection("sonar.out -> gauge.heard", "<validity field=\"range\"><min>0.03</min></validity>");
    Profiles::new(&plain.replace("<port_connections>\n", &format!("<port_connections>\n{wire}")))
}

#[test]
fn a_value_that_stays_bad_climbs_the_ladder() {
    let daemon = Running::start(sonar(1).path(), &[]);
    let faults = daemon.journal("fault", 3);
    let actions: Vec<_> = faults.iter().map(|fault| fault["action"].as_str().unwrap()).collect();
    assert_eq!(actions, ["reset", "reset", "stop"]);
}

#[test]
fn what_a_successor_reports_in_its_first_callback_is_answered() {
    let profiles = sonar(1);
    let secondary = "<reset limit=\"0\" within=\"60s\"/><secondary reference=\"Sonar.xml\" preload=\"instance\"/>";
    profiles.replace("app.xml", "<reset limit=\"2\" within=\"60s\"/>", secondary);
    let daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 2);
    let actions: Vec<_> = faults.iter().map(|fault| fault["action"].as_str().unwrap()).collect();
    assert_eq!(actions, ["replace", "stop"]);
}

#[test]
fn a_reload_that_changes_nothing_begins_no_check_anew() {
    let profiles = sonar(1);
    profiles.replace("app.xml", "<severity>reset</severity>", "<severity>ignore</severity>");
    let mut daemon = Running::start(profiles.path(), &[]);
    let _ = daemon.journal("fault", 1);
    for number in 1..=5 {
        daemon.signal("HUP");
        let _ = daemon.journal("reload", number);
    }
    daemon.stop();
    assert_eq!(daemon.entries("fault").len(), 1);
}

#[test]
fn a_changed_executor_gets_a_thread_of_its_new_schedule() {
    let main = "<executor>main</executor>";
    let profiles = Profiles::new(&application(&[slot("diary", "Diary", main)], &[]));
    let executor =
        |cpu: &str| format!("<system_profile><name>s</name><executor name=\"main\" cpu=\"{cpu}\"/></system_profile>");
    profiles.write("system.xml", &executor("0"));
    let mut daemon = Running::start(profiles.path(), &[]);
    assert!(daemon.lines("cannot be used").is_empty());
    profiles.write("system.xml", &executor("1001"));
    daemon.signal("HUP");
    assert_eq!(daemon.journal("reload", 1)[0]["changed"], serde_json::json!(["diary"]));
    // A new thread tried the new processors.
    daemon.wait_for("processors [1001] cannot be used");
    daemon.stop();
}

/// Where a section lies in a file.
fn section(bytes: &[u8], name: &str) -> (usize, usize) {
    use object::{Object, ObjectSection};
    let file = object::File::parse(bytes).unwrap();
    let (from, len) = file.section_by_name(name).and_then(|section| section.file_range()).unwrap();
    (from as usize, len as usize)
}

#[test]
fn a_plugin_file_that_is_half_written_is_refused_while_the_robot_runs() {
    let plugins = tempfile::tempdir().unwrap();
    let profiles = Profiles::new(&application(&[slot("diary", "Diary", "")], &[]));
    let directory = plugins.path().display().to_string();
    let mut daemon = Running::start(profiles.path(), &["--plugins", &directory]);
    let mut bytes = std::fs::read(plugin_dir().join("libbasic.so")).unwrap();
    // The relocations are gone, the tables that are read first are there.
    let (from, len) = section(&bytes, ".rela.dyn");
    bytes[from..from + len].fill(0);
    std::fs::write(plugins.path().join("libhalf.so"), bytes).unwrap();
    profiles.replace("Ticker.xml", "libbasic.so", "libhalf.so");
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("ticker", "Ticker", "")));
    daemon.signal("HUP");
    let reload = daemon.journal("reload", 1).remove(0);
    assert_eq!(reload["accepted"], false);
    let reason = reload["reasons"][0].as_str().unwrap();
    assert!(reason.contains("ends the process that does it"), "{reason}");
    assert_eq!(daemon.stop().len(), 1);
}

#[test]
fn one_component_that_hangs_does_not_hold_up_the_others_for_long() {
    let mut slots: Vec<String> =
        (0..20).map(|number| slot(&format!("diary{number}"), "Diary", "<executor>main</executor>")).collect();
    slots.push(slot("stubborn", "Stubborn", "<executor>main</executor>"));
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.executors(&["main"]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.stop();
    // It is ended, and the others stop in order on the thread that took over.
    let faults = daemon.entries("fault");
    assert_eq!(
        (faults.len(), faults[0]["slot"].as_str(), faults[0]["symptom"].as_str()),
        (1, Some("stubborn"), Some("hang"))
    );
    assert!(daemon.lines("did not return within").is_empty());
}
