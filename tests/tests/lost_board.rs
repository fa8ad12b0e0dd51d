//! The serial line of the simulated robot is cut while it drives, and comes back.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;
use tests::asking::ask;
use tests::profiles::plugin_dir;
use tests::running::Running;

/// The simulator. When it ends, its side of the line is closed.
struct Robot {
    process: Child,
    record: PathBuf,
}

impl Robot {
    fn play(place: &Path, record: &str) -> Self {
        let record = place.join(record);
        let mut command = Command::new(plugin_dir().join("robot-sim"));
        command.arg("--board").arg(place.join("board")).arg("--camera").arg(place.join("camera"));
        command.arg("--record").arg(&record).args(["--timeout", "1000", "--linger", "1000"]);
        let mut process = command.stdout(Stdio::piped()).spawn().expect("the simulator is built");
        let mut lines = BufReader::new(process.stdout.take().expect("piped")).lines();
        assert!(lines.any(|line| line.is_ok_and(|line| line.starts_with("ready "))), "the simulator gets ready");
        std::thread::spawn(move || lines.for_each(drop));
        Self { process, record }
    }

    /// How fast the wheels really turn, at the fastest.
    fn speed(&self) -> f64 {
        let text = std::fs::read_to_string(&self.record).unwrap_or_default();
        let newest = text.lines().rev().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let newest = newest.into_iter().find(|line| line["kind"] == "truth").unwrap_or_default();
        let wheels = newest["wheels"].as_array().cloned().unwrap_or_default();
        wheels.iter().filter_map(Value::as_f64).map(f64::abs).fold(0.0, f64::max)
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The navigation robot, with another severity of a lost board, and an addition to its system profile.
fn profiles(place: &Path, severity: &str, system: &str) -> PathBuf {
    let profiles = place.join("profile");
    std::fs::create_dir(&profiles).unwrap();
    let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/navigation");
    for file in std::fs::read_dir(original).unwrap().map(Result::unwrap) {
        let text = std::fs::read_to_string(file.path()).unwrap();
        let text = text.replace("/tmp/robot-", &format!("{}/", place.display()));
        let text = text.replace("<plugins>../../target/release</plugins>", "");
        let text = text.replacen("<severity symptom=\"device\">ignore</severity>", severity, 1);
        let text = text.replace("</system_profile>", &format!("{system}</system_profile>"));
        std::fs::write(profiles.join(file.file_name()), text).unwrap();
    }
    profiles
}

fn of_board(daemon: &Running, kind: &str) -> Vec<Value> {
    let of_board = |line: &Value| line["slot"] == "board" && line["symptom"] == "device";
    daemon.entries(kind).into_iter().filter(of_board).collect()
}

#[test]
fn a_line_that_is_cut_is_a_lost_device_and_heals_when_it_is_back() {
    let place = TempDir::new().unwrap();
    let severity = "<severity symptom=\"device\">reset</severity>";
    let robot = Robot::play(place.path(), "first");
    let directory = profiles(place.path(), severity, "");
    // As often as it takes: each attempt to open it is a reset.
    let text = std::fs::read_to_string(directory.join("navigation.xml")).unwrap();
    let text = text.replacen("<reset limit=\"5\" within=\"10s\"/>", "<reset limit=\"1000\" within=\"10s\"/>", 1);
    std::fs::write(directory.join("navigation.xml"), text).unwrap();
    let daemon = Running::start(&directory, &[]);
    daemon.until("the wheels turn", || robot.speed() > 0.5);
    assert!(of_board(&daemon, "fault").is_empty());

    drop(robot);
    daemon.until("the loss", || !of_board(&daemon, "fault").is_empty());
    let fault = of_board(&daemon, "fault").remove(0);
    let board = place.path().join("board").display().to_string();
    assert_eq!(fault["evidence"]["device"].as_str(), Some(board.as_str()), "{fault}");
    assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("reset"), Some("recovered")), "{fault}");
    let shown = ask(&daemon, "status").out;
    assert!(shown.contains(&format!("slot board: {board} is lost")), "{shown}");

    let robot = Robot::play(place.path(), "second");
    daemon.until("the end of it", || !of_board(&daemon, "healed").is_empty());
    daemon.until("the wheels turn again", || robot.speed() > 0.5);
    assert!(!ask(&daemon, "status").out.contains("is lost"));
}

#[test]
fn a_cut_line_may_be_an_emergency_and_an_operator_brings_the_robot_back() {
    let place = TempDir::new().unwrap();
    let robot = Robot::play(place.path(), "first");
    let severity = "<severity symptom=\"device\">emergency</severity>";
    let actuator = "<emergency><actuator component=\"board\"/></emergency>";
    let daemon = Running::start(&profiles(place.path(), severity, actuator), &[]);
    daemon.until("the wheels turn", || robot.speed() > 0.5);

    drop(robot);
    daemon.until("the emergency stop", || !daemon.entries("emergency").is_empty());
    let fault = of_board(&daemon, "fault").remove(0);
    assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("emergency"), Some("stopped")), "{fault}");
    assert_eq!(daemon.entries("emergency")[0]["root"], fault["seq"]);
    assert_eq!(ask(&daemon, "component reset board").code, Some(7), "it is latched");

    let robot = Robot::play(place.path(), "second");
    daemon.until("the wheels turn again", || {
        let _ = ask(&daemon, "fault clear");
        let _ = ask(&daemon, "component reset board");
        robot.speed() > 0.5
    });
    assert!(!of_board(&daemon, "healed").is_empty());
}
