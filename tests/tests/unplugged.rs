//! The paper's first case on the simulated robot: an unplugged ultrasonic sensor is found by the port.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use tempfile::TempDir;
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

#[test]
fn an_unplugged_sonar_is_found_by_the_port_and_a_plugged_one_is_not() {
    let (unplugged, plugged) = (Robot::start(&["--unplug", "3@2"]), Robot::start(&[]));
    let (daemon, mut other) = (unplugged.daemon(), plugged.daemon());
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("board"), Some("validity")));
    let evidence = &fault["evidence"];
    assert_eq!((evidence["port"].as_str(), evidence["field"].as_str()), (Some("raw"), Some("ranges[3]")));
    assert_eq!((evidence["value"].as_f64(), evidence["limit"].as_f64()), (Some(0.0), Some(0.03)));
    // It stays unplugged: one fault.
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!((daemon.entries("fault").len(), daemon.entries("healed").len()), (1, 0));
    let slots = other.stop();
    assert!(slots.iter().all(|slot| slot["state"] == "active" || slot["faults"] == 0), "{slots:?}");
    assert!(other.entries("fault").is_empty(), "{:?}", other.entries("fault"));
}
