//! Checkpoints outlive the daemon: killed, crashed or restarted for suspect memory, it goes on from them; ended in order, told
//! to begin anew, or with what is torn or of another build, it does not.

use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempDir;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

const RULES: &str = "<fault_tolerance><severity>reset</severity><checkpoint period=\"10ms\"/></fault_tolerance>";

/// A slot that counts, and keeps its number in a field and in memory of its own.
struct Counter {
    profiles: Profiles,
    scratch: TempDir,
}

impl Counter {
    fn new() -> Self {
        let profiles = Profiles::new(&application(&[slot("keeper", "Keeper", RULES)], &[]));
        profiles.describe(&plugin_dir().join("libhostile.so"));
        Self { profiles, scratch: TempDir::new().unwrap() }
    }

    fn journal(&self) -> PathBuf {
        self.scratch.path().join("journal.jsonl")
    }

    fn file(&self) -> PathBuf {
        self.scratch.path().join("journal.jsonl.checkpoints")
    }

    fn run(&self, arguments: &[&str]) -> Running {
        let daemon = Running::spawn_on(&self.journal(), self.profiles.path(), arguments).ready();
        daemon.wait_for("keeper goes on from");
        daemon
    }

    /// Runs for a while, then kills it.
    fn run_and_kill(&self) {
        let mut daemon = self.run(&[]);
        std::thread::sleep(Duration::from_millis(300));
        daemon.signal("KILL");
        assert_eq!(daemon.wait().signal(), Some(9));
    }
}

/// The numbers that the instance of this run went on from: outside it, and inside.
fn began_with(daemon: &Running) -> (u64, u64) {
    went_on_with(daemon, 0)
}

fn assert_goes_on(daemon: &Running) {
    let (outside, inside) = began_with(daemon);
    assert!(outside > 20 && outside == inside, "{outside} and {inside}; the log:\n{}", daemon.log());
    daemon.wait_for("slot keeper: its checkpoint of the run before is taken up");
    let taken_up = daemon.entries("start").last().unwrap()["taken_up"].clone();
    assert_eq!(taken_up[0]["slot"], "keeper");
    assert!(taken_up[0]["checkpoint"].as_u64() > Some(0));
}

fn assert_begins_anew(daemon: &Running) {
    assert_eq!(began_with(daemon), (0, 0), "the log:\n{}", daemon.log());
    assert_eq!(daemon.entries("start").last().unwrap().get("taken_up"), None);
}

#[test]
fn after_kill_9_a_slot_goes_on_and_after_an_end_in_order_it_begins_anew() {
    let counter = Counter::new();
    counter.run_and_kill();
    let mut before = 0;
    for _ in 0..3 {
        let mut daemon = counter.run(&[]);
        assert_goes_on(&daemon);
        let (now, _) = began_with(&daemon);
        assert!(now > before, "{now} after {before}");
        before = now;
        std::thread::sleep(Duration::from_millis(200));
        daemon.signal("KILL");
        daemon.wait();
    }
    counter.run(&[]).stop();
    assert!(!counter.file().exists(), "an end in order leaves none");
    let mut daemon = counter.run(&[]);
    assert_begins_anew(&daemon);
    daemon.stop();
}

#[test]
fn after_a_crash_of_the_daemon_itself_a_slot_goes_on() {
    let counter = Counter::new();
    let mut daemon = counter.run(&["--inject", "daemon:crash.segv@0.4"]);
    assert_eq!(daemon.wait().signal(), Some(11));
    let mut daemon = counter.run(&[]);
    assert_goes_on(&daemon);
    daemon.wait_for("ended by a crash of the daemon itself");
    daemon.stop();
}

#[test]
fn after_a_restart_for_suspect_memory_a_slot_goes_on() {
    let counter = Counter::new();
    let system = "<system_profile on_taint=\"restart\"><name>s</name></system_profile>";
    counter.profiles.write("system.xml", system);
    let hostile =
        slot("wild", "Stuck", "<properties><property name=\"how\" type=\"string\">corrupt</property></properties>");
    counter.profiles.replace("app.xml", "</subcomponents>", &format!("{hostile}</subcomponents>"));
    let mut daemon = counter.run(&[]);
    assert_eq!(daemon.wait().code(), Some(1), "the log:\n{}", daemon.log());
    assert_eq!(daemon.entries("restart").len(), 1);
    counter.profiles.replace("app.xml", &hostile, "");
    let mut daemon = counter.run(&[]);
    let (outside, inside) = began_with(&daemon);
    assert!(outside > 0 && outside == inside, "{outside} and {inside}");
    daemon.wait_for("slot keeper: its checkpoint of the run before is taken up");
    daemon.stop();
}

/// The numbers that an instance of this run went on from: the first one, or one of its successors.
fn went_on_with(daemon: &Running, instance: usize) -> (u64, u64) {
    daemon.wait_for_lines("keeper goes on from", instance + 1);
    let line = &daemon.lines("keeper goes on from")[instance];
    let numbers = line.split("goes on from ").nth(1).and_then(|text| text.split_once(" and ")).unwrap();
    (numbers.0.parse().unwrap(), numbers.1.parse().unwrap())
}

#[test]
fn who_cuts_the_file_short_takes_nothing_from_who_runs() {
    let counter = Counter::new();
    let mut daemon = counter.run(&["--inject", "keeper:crash.segv@2"]);
    std::fs::File::options().write(true).open(counter.file()).unwrap().set_len(0).unwrap();
    let cut = daemon.journal("checkpoints", 1).remove(0);
    assert_eq!((cut["event"].as_str(), cut["file"].as_str()), (Some("cut"), counter.file().to_str()), "{cut}");
    daemon.wait_for("somebody cut the file short");
    // The slot is blamed for nothing, and what it keeps serves its successor.
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["symptom"].as_str(), fault["injected"].as_bool()), (Some("crash.segv"), Some(true)), "{fault}");
    assert!(fault["checkpoint"].as_u64() > Some(0), "{fault}");
    let (outside, inside) = went_on_with(&daemon, 1);
    assert!(outside > 20 && outside == inside, "{outside} and {inside}");
    daemon.signal("KILL");
    assert_eq!(daemon.wait().signal(), Some(9));
    let mut daemon = counter.run(&[]);
    assert_begins_anew(&daemon);
    daemon.stop();
    assert_eq!(daemon.entries("checkpoints").len(), 1, "nobody cut that of the second run");
}

#[test]
fn a_slot_that_a_reload_builds_anew_goes_on_from_its_checkpoint() {
    let counter = Counter::new();
    // So long that only a copy made for the reload can be new.
    counter.profiles.replace("app.xml", "period=\"10ms\"", "period=\"60s\"");
    let mut daemon = counter.run(&[]);
    std::thread::sleep(Duration::from_millis(300));
    counter.profiles.replace("app.xml", "period=\"60s\"", "period=\"50s\"");
    daemon.signal("HUP");
    let reload = daemon.journal("reload", 1).remove(0);
    assert_eq!((&reload["changed"][0], &reload["taken_up"][0]), (&"keeper".into(), &"keeper".into()), "{reload}");
    let (outside, inside) = went_on_with(&daemon, 1);
    assert!(outside > 20 && outside == inside, "{outside} and {inside}; the log:\n{}", daemon.log());
    daemon.wait_for("slot keeper: built anew, it goes on from its checkpoint");
    assert!(daemon.entries("fault").is_empty());

    counter.profiles.replace("app.xml", "<reference>Keeper.xml", "<reference>Downer.xml");
    daemon.signal("HUP");
    let reload = daemon.journal("reload", 2).remove(1);
    assert!(reload["accepted"] == true && reload["taken_up"].is_null(), "{reload}");
    daemon.wait_for(
        "slot keeper: built anew, it does not go on from its checkpoint: it is of class Keeper, not of Downer",
    );
    daemon.stop();
}

#[test]
fn told_to_forget_or_with_another_layout_it_begins_anew() {
    let counter = Counter::new();
    counter.run_and_kill();
    let mut daemon = counter.run(&["--fresh"]);
    assert_begins_anew(&daemon);
    std::thread::sleep(Duration::from_millis(100));
    daemon.signal("KILL");
    daemon.wait();
    // Another class in the same place.
    counter.profiles.replace("app.xml", "<reference>Keeper.xml", "<reference>Downer.xml");
    let mut daemon = Running::spawn_on(&counter.journal(), counter.profiles.path(), &[]).ready();
    daemon.wait_for("slot keeper: its checkpoint of the run before is not taken up");
    daemon.stop();
}

fn change(file: &Path, change: impl FnOnce(&mut Vec<u8>)) {
    let mut bytes = std::fs::read(file).unwrap();
    change(&mut bytes);
    std::fs::write(file, bytes).unwrap();
}

#[test]
fn what_is_damaged_is_refused_and_told() {
    type Damage = fn(&mut Vec<u8>);
    let damages: [(&str, Damage); 4] = [
        ("its header is damaged", |bytes| bytes[30] ^= 1),
        ("another version", |bytes| bytes[7] = 99),
        ("it is too short", |bytes| bytes.truncate(100)),
        // The table of the first record.
        ("the record at byte 4096: it is damaged", |bytes| bytes[4096 + 80] ^= 1),
    ];
    for (told, damage) in damages {
        let counter = Counter::new();
        counter.run_and_kill();
        change(&counter.file(), damage);
        let mut daemon = counter.run(&[]);
        assert_begins_anew(&daemon);
        daemon.wait_for(told);
        daemon.stop();
    }
}

#[test]
fn of_two_copies_the_one_that_is_whole_is_taken_up() {
    let counter = Counter::new();
    counter.run_and_kill();
    // Both fields of the second copy; of a record of 4 KiB for its head and 2 KiB for each copy.
    change(&counter.file(), |bytes| bytes[8192 + 2048..][..128].iter_mut().for_each(|byte| *byte ^= 0x55));
    let mut daemon = counter.run(&[]);
    assert_goes_on(&daemon);
    daemon.stop();
}

#[test]
fn where_there_is_no_file_to_be_had_it_runs_all_the_same() {
    let counter = Counter::new();
    let mut daemon = counter.run(&["--checkpoints", "/dev/full", "--inject", "keeper:crash.segv@0.3"]);
    daemon.wait_for("they do not outlive the daemon");
    assert!(daemon.journal("fault", 1)[0]["checkpoint"].as_u64() > Some(0), "recovered from the heap");
    daemon.stop();
}

#[test]
fn a_second_daemon_with_the_same_file_keeps_to_its_heap() {
    let counter = Counter::new();
    let mut first = counter.run(&[]);
    let (journal, file) = (counter.scratch.path().join("other.jsonl"), counter.file());
    let shared = ["--checkpoints", file.to_str().unwrap()];
    let mut second = Running::spawn_on(&journal, counter.profiles.path(), &shared).ready();
    second.wait_for("another daemon keeps its checkpoints in it");
    second.stop();
    assert!(counter.file().exists(), "the first one's is untouched");
    std::thread::sleep(Duration::from_millis(100));
    first.signal("KILL");
    first.wait();
    let mut third = counter.run(&[]);
    assert_goes_on(&third);
    third.stop();
}
