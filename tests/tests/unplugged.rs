//! The paper's first case on the simulated robot: an unplugged ultrasonic sensor is found by the port.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serde_json::Value;
use tempfile::TempDir;
use tests::asking::{finish, start};
use tests::profiles::plugin_dir;
use tests::running::Running;

/// The simulated robot, standing in a small room.
struct Robot {
    process: Child,
    scratch: TempDir,
}

impl Robot {
    fn start(options: &[&str]) -> Self {
        let scratch = TempDir::new().unwrap();
        let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/unplugged_sonar");
        let profile = scratch.path().join("profile");
        std::fs::create_dir(&profile).unwrap();
        let board = scratch.path().join("board");
        for file in std::fs::read_dir(original).unwrap().map(Result::unwrap) {
            let text = std::fs::read_to_string(file.path()).unwrap();
            let text = text.replace("/tmp/robot-board", &board.to_string_lossy());
            std::fs::write(profile.join(file.file_name()), text).unwrap();
        }
        let mut command = Command::new(plugin_dir().join("robot-sim"));
        command.arg("--board").arg(&board).arg("--world").arg(profile.join("room.json"));
        let command = command.args(["--timeout", "600"]).args(options).stdout(Stdio::piped());
        let mut process = command.spawn().expect("the simulator is built");
        let mut line = String::new();
        BufReader::new(process.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
        assert!(line.starts_with("ready board="), "{line}");
        Self { process, scratch }
    }

    fn daemon(&self) -> Running {
        Running::start(&self.scratch.path().join("profile"), &[])
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        let _ended = self.process.kill();
        let _ended = self.process.wait();
    }
}

/// Somebody who writes down what passes a port.
struct Ear {
    pid: u32,
    heard: JoinHandle<Vec<Value>>,
}

impl Ear {
    fn at(daemon: &Running, port: &str) -> Self {
        let child = start(daemon, &format!("port echo {port} --format json"));
        Self { pid: child.id(), heard: thread::spawn(|| finish(child).json()) }
    }

    /// When each ring passed, and what it held.
    fn end(self) -> Vec<(u64, Vec<f64>)> {
        assert!(Command::new("kill").arg(self.pid.to_string()).status().unwrap().success());
        let ring = |answer: Value| {
            let echo = &answer["echo"];
            let ranges = echo["value"]["ranges"].as_array().unwrap().iter().map(|range| range.as_f64().unwrap());
            (echo["stamp_ns"].as_u64().unwrap(), ranges.collect())
        };
        self.heard.join().unwrap().into_iter().map(ring).collect()
    }
}

/// The journal's entries of that kind about values out of range.
fn invalid(daemon: &Running, kind: &str) -> Vec<Value> {
    daemon.entries(kind).into_iter().filter(|entry| entry["symptom"] == "validity").collect()
}

#[test]
fn an_unplugged_sonar_is_found_with_its_first_value_and_the_reader_never_hears_it() {
    let robot = Robot::start(&["--unplug", "3@6"]);
    let daemon = robot.daemon();
    let (raw, filtered) = (Ear::at(&daemon, "board.echoes"), Ear::at(&daemon, "sonar.ranges"));
    daemon.until("the fault", || !invalid(&daemon, "fault").is_empty());
    let fault = invalid(&daemon, "fault").remove(0);
    assert_eq!(fault["slot"], "board");
    let evidence = &fault["evidence"];
    assert_eq!((evidence["port"].as_str(), evidence["field"].as_str()), (Some("raw"), Some("ranges[3]")));
    assert_eq!((evidence["value"].as_f64(), evidence["limit"].as_f64()), (Some(0.0), Some(0.03)));
    thread::sleep(Duration::from_secs(1));
    let (raw, filtered) = (raw.end(), filtered.end());
    let first_bad = raw.iter().position(|(_, ranges)| ranges[3] == 0.0).expect("it was pulled out");
    assert!(first_bad > 0, "it was heard before");
    // Rounds of one look at the line follow each other at once; the next look is a period later.
    let (first_ns, at_ns) = (raw[first_bad].0, fault["mono_ns"].as_u64().unwrap());
    let next_ns = raw.iter().map(|(stamp_ns, _)| *stamp_ns).find(|stamp_ns| *stamp_ns > first_ns + 10_000_000).unwrap();
    assert!((first_ns..next_ns).contains(&at_ns), "found with the first value: {first_ns}, {at_ns}, {next_ns}");
    assert!(raw[first_bad..].len() > 5 && raw[first_bad..].iter().all(|(_, ranges)| ranges[3] == 0.0));
    // Without it the filter would say 3 m; the wall is nearer.
    assert!(!filtered.is_empty() && filtered.iter().all(|(_, ranges)| (0.5..1.5).contains(&ranges[3])), "{filtered:?}");
    // It stays unplugged: one fault.
    assert_eq!((invalid(&daemon, "fault").len(), invalid(&daemon, "healed").len()), (1, 0));
}

#[test]
fn a_missed_echo_is_no_fault() {
    let robot = Robot::start(&[]);
    let daemon = robot.daemon();
    let raw = Ear::at(&daemon, "board.echoes");
    thread::sleep(Duration::from_secs(6));
    // One in eighty, of twelve.
    let missed = raw.end().iter().flat_map(|(_, ranges)| ranges).filter(|range| **range == 3.0).count();
    assert!(missed > 0, "none was missed");
    assert!(invalid(&daemon, "fault").is_empty(), "{:?}", daemon.entries("fault"));
}
