//! The daemon's own death: a journal that survives it, actuators that are stopped, a next start that knows.
//!
//! `ROUNDS=200 cargo test -p tests --test death` kills it that many times; `SEED` repeats a run.

use std::io::{ErrorKind, Read};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::time::Duration;

use board_protocol::{Command, Encoder, WheelVelocities};
use framework_daemon::fault::journal::unseal;
use serde_json::Value;
use serialport::{SerialPort, TTYPort};
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

const RESET: &str =
    "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";

/// xorshift64: the same seed, the same moments.
struct Moments(u64);

impl Moments {
    fn below(&mut self, bound: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % bound
    }
}

fn number(name: &str, otherwise: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

/// A fault every few milliseconds from `ready` on.
fn fault_load() -> Vec<String> {
    let symptoms = ["crash.segv", "crash.panic", "crash.fpe", "error"];
    let each = |number: usize| {
        let (slot, symptom) = (["ticker", "diary"][number % 2], symptoms[number % symptoms.len()]);
        ["--inject".to_owned(), format!("{slot}:{symptom}@{:.3}", 0.003 * number as f64)]
    };
    (0..150).flat_map(each).collect()
}

/// Lines of a run: all complete ones must be whole, and the last may be torn.
fn whole_lines(run: &str, after_torn: bool) -> (Vec<Value>, bool) {
    let run = if after_torn { run.strip_prefix('\n').unwrap_or(run) } else { run };
    let (complete, torn): (Vec<_>, Vec<_>) = run.split_inclusive('\n').partition(|line| line.ends_with('\n'));
    assert!(torn.len() <= 1);
    let whole = |line: &&str| unseal(line).unwrap_or_else(|| panic!("a complete line is damaged: {line}"));
    (complete.iter().map(whole).collect(), !torn.is_empty())
}

/// Journals are moved away to keep them or to make room; the daemon's last words find the new one, too.
#[test]
fn a_journal_that_is_moved_away_goes_on_in_a_new_file() {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", RESET)], &[]));
    let scratch = tempfile::tempdir().unwrap();
    let (journal, kept) = (scratch.path().join("journal.jsonl"), scratch.path().join("journal.jsonl.1"));
    let faults = ["--inject", "ticker:crash.segv@0.3", "--inject", "daemon:crash.segv@0.8"];
    let mut daemon = Running::spawn_on(&journal, profiles.path(), &faults).ready();
    std::fs::rename(&journal, &kept).unwrap();
    let fault = daemon.journal("fault", 1).remove(0);
    let mut other = Running::spawn_on(&journal, profiles.path(), &[]);
    assert!(!other.wait().success(), "the new one is this daemon's as well");
    daemon.wait();
    assert_eq!(daemon.entries("crash").len(), 1);
    let (before, _) = whole_lines(&std::fs::read_to_string(&kept).unwrap(), false);
    let last = before.last().unwrap();
    assert_eq!(
        (last["kind"].as_str(), fault["seq"].as_u64()),
        (Some("start"), last["seq"].as_u64().map(|seq| seq + 1))
    );
}

#[test]
fn the_journal_survives_kill_9_at_any_moment() {
    let (rounds, seed) = (number("ROUNDS", 20), number("SEED", 0x5EED));
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", RESET), slot("diary", "Diary", RESET)], &[]));
    let scratch = tempfile::tempdir().unwrap();
    let journal = scratch.path().join("journal.jsonl");
    let load = fault_load();
    let load: Vec<&str> = load.iter().map(String::as_str).collect();
    let (mut moments, mut seen, mut torn, mut faults) = (Moments(seed | 1), 0, false, 0);
    for round in 0..rounds {
        let mut daemon = Running::spawn_on(&journal, profiles.path(), &load);
        // Some in the middle of the boot.
        if round % 5 != 0 {
            daemon = daemon.ready();
        }
        std::thread::sleep(Duration::from_micros(moments.below(300_000)));
        daemon.signal("KILL");
        assert_eq!(daemon.wait().signal(), Some(9), "round {round} of seed {seed}");
        let text = std::fs::read_to_string(&journal).unwrap_or_default();
        let (lines, now_torn) = whole_lines(&text[seen..], torn);
        faults += lines.iter().filter(|line| line["kind"] == "fault").count();
        (seen, torn) = (text.len(), now_torn);
    }
    assert!(faults as u64 > rounds, "there was no load to speak of: {faults} faults");
    let mut daemon = Running::spawn_on(&journal, profiles.path(), &[]).ready();
    daemon.wait_for("the last run on this journal did not end in order");
    daemon.signal("TERM");
    assert!(daemon.wait().success());
    let text = std::fs::read_to_string(&journal).unwrap();
    let (lines, _) = whole_lines(&text[seen..], torn);
    let kinds: Vec<_> = lines.iter().map(|line| line["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["start", "stop"]);
}

/// A robot whose motion board is the other end of a pseudo-terminal, and that takes its time to end.
struct Robot {
    board: TTYPort,
    _device: TTYPort,
    profiles: Profiles,
}

impl Robot {
    fn new() -> Self {
        let (mut board, device) = TTYPort::pair().expect("the system has pseudo-terminals");
        board.set_timeout(Duration::from_millis(200)).expect("a timeout can be set");
        let name = device.name().expect("it has a name");
        let inside =
            format!("<properties><property name=\"device\" type=\"string\">{name}</property></properties>{RESET}");
        let mut slots = vec![slot("board", "MotionBoard", &inside)];
        slots.extend((0..20).map(|number| slot(&format!("stubborn{number}"), "Stubborn", "")));
        let profiles = Profiles::new(&application(&slots, &[]));
        profiles.describe(&plugin_dir().join("libmotion_board.so"));
        Self { board, _device: device, profiles }
    }

    /// All that has come, until nothing more does.
    fn heard(&mut self) -> Vec<u8> {
        let (mut all, mut bytes) = (Vec::new(), [0; 4096]);
        loop {
            match self.board.read(&mut bytes) {
                Ok(count) => all.extend_from_slice(&bytes[..count]),
                Err(error) => {
                    assert_eq!(error.kind(), ErrorKind::TimedOut);
                    return all;
                }
            }
        }
    }
}

/// Number 0 on the line: the daemon in good health sends it once.
fn stop_bytes() -> Vec<u8> {
    let neutral = WheelVelocities { left_rad_s: 0.0, right_rad_s: 0.0 };
    Encoder::new().encode(&Command::WheelVelocities(neutral)).to_vec()
}

/// Runs a robot until it is driven; then something happens to it.
fn die(journal: &Path, arguments: &[&str], happens: impl FnOnce(&Running)) -> (std::process::ExitStatus, Vec<u8>) {
    let mut robot = Robot::new();
    let mut daemon = Running::spawn_on(journal, robot.profiles.path(), arguments).ready();
    daemon.wait_for("motion board opened");
    std::thread::sleep(Duration::from_millis(100));
    happens(&daemon);
    let status = daemon.wait();
    (status, robot.heard())
}

fn dies_by(arguments: &[&str], happens: impl FnOnce(&Running), signal: i32) -> Value {
    let crash = last_words(arguments, happens, signal, "the last run ended by a crash of the daemon itself: SIG");
    assert_eq!(crash["kind"], "crash");
    crash
}

/// What the journal's last line says of a daemon that ended by `signal` after it had stopped the motors.
fn last_words(arguments: &[&str], happens: impl FnOnce(&Running), signal: i32, told: &str) -> Value {
    let scratch = tempfile::tempdir().unwrap();
    let journal = scratch.path().join("journal.jsonl");
    let (status, heard) = die(&journal, arguments, happens);
    assert_eq!(status.signal(), Some(signal));
    let stop = stop_bytes();
    assert!(heard.len() > 3 * stop.len() && heard.ends_with(&stop), "the stop is not the last word: {heard:?}");
    let text = std::fs::read_to_string(&journal).unwrap();
    let crash = unseal(text.lines().last().unwrap()).expect("the crash record is whole");
    assert_eq!((crash["signal"].as_i64(), crash["safe_outputs"].as_u64()), (Some(i64::from(signal)), Some(1)));
    let robot = Robot::new();
    let next = Running::spawn_on(&journal, robot.profiles.path(), &[]).ready();
    next.wait_for(told);
    crash
}

#[test]
fn a_trap_in_the_daemon_itself_stops_the_motors_first() {
    let crash = dies_by(&["--inject", "daemon:crash.segv@0.2"], |_| (), 11);
    assert_eq!((crash["address"].as_u64(), crash.get("sender")), (Some(8), None));
    assert!(crash["pc"].as_u64() > crash["base"].as_u64() && crash["base"].as_u64() > Some(0));
}

#[test]
fn an_abort_or_a_panic_of_the_daemon_itself_stops_the_motors_too() {
    dies_by(&["--inject", "daemon:crash.abort@0.2"], |_| (), 6);
    dies_by(&["--inject", "daemon:crash.panic@0.2"], |_| (), 6);
}

#[test]
fn a_fatal_signal_from_outside_stops_the_motors_first() {
    let crash = dies_by(&[], |daemon| daemon.signal("SEGV"), 11);
    assert!(crash["sender"].as_u64() > Some(0));
}

#[test]
fn a_second_signal_stops_the_motors_before_it_leaves_at_once() {
    // Those that do not return from `stop` were started last, so they are asked first.
    let twice = |daemon: &Running| {
        daemon.signal("TERM");
        daemon.wait_for("(Stubborn): hang");
        daemon.signal("TERM");
    };
    let left = last_words(&[], twice, 9, "the last run was left at once by a second signal");
    assert_eq!(left["kind"], "left");
}

#[test]
fn a_component_that_trapped_leaves_one_stop_for_its_device() {
    let crash = dies_by(
        &["--inject", "board:crash.segv@0.05", "--inject", "board:crash.ill@0.1", "--inject", "daemon:crash.segv@0.4"],
        |_| (),
        11,
    );
    assert_eq!(crash["safe_outputs"], 1);
}

#[test]
fn a_slot_that_is_called_daemon_is_a_slot() {
    let profiles = Profiles::new(&application(&[slot("daemon", "Diary", RESET)], &[]));
    let mut daemon = Running::start(profiles.path(), &["--inject", "daemon:crash.segv@0.1"]);
    assert_eq!(daemon.journal("fault", 1)[0]["slot"], "daemon");
    daemon.stop();
}

#[test]
fn what_the_daemon_itself_cannot_provoke_is_wrong_usage() {
    let profiles = Profiles::new(&application(&[slot("diary", "Diary", "")], &[]));
    let mut daemon = Running::spawn(profiles.path(), &["--inject", "daemon:error@1"]);
    assert_eq!(daemon.wait().code(), Some(2));
    daemon.wait_for("only these can be provoked: crash.segv, crash.abort, crash.panic");
}
