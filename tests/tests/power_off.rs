//! The power of the left wheels fails while the simulated robot drives; no component notices, its model does.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;
use tests::profiles::plugin_dir;
use tests::running::Running;

/// The simulator, ended when the test ends.
struct Robot(Child);

impl Robot {
    /// Plays the board at that device, with the power of the left wheels failing so many seconds after it begins to drive.
    fn play(board: &Path, record: &Path, power_off: Option<&str>) -> Self {
        let mut command = Command::new(plugin_dir().join("robot-sim"));
        command.arg("--board").arg(board).arg("--record").arg(record).args(["--timeout", "1000", "--linger", "1000"]);
        if let Some(seconds) = power_off {
            command.args(["--left-power-off", seconds]);
        }
        let mut child = command.stdout(Stdio::piped()).spawn().expect("the simulator is built");
        let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        assert!(lines.any(|line| line.is_ok_and(|line| line.starts_with("ready "))), "the simulator gets ready");
        std::thread::spawn(move || lines.for_each(drop));
        Self(child)
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A run: when the power failed, where it did, and the faults of the robot until its board stopped, or for a while.
struct Run {
    power_off_ns: Option<u64>,
    faults: Vec<Value>,
    states: Vec<Value>,
}

fn drive(power_off: Option<&str>) -> Run {
    let scratch = TempDir::new().unwrap();
    let (board, record) = (scratch.path().join("board"), scratch.path().join("record.jsonl"));
    let profile = scratch.path().join("profile");
    std::fs::create_dir(&profile).unwrap();
    let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/encoder_monitor");
    for file in std::fs::read_dir(original).unwrap().map(Result::unwrap) {
        let text = std::fs::read_to_string(file.path()).unwrap();
        std::fs::write(profile.join(file.file_name()), text.replace("/tmp/robot-board", &board.to_string_lossy()))
            .unwrap();
    }
    let robot = Robot::play(&board, &record, power_off);
    let mut daemon = Running::start(&profile, &[]);
    if power_off.is_some() {
        let _ = daemon.journal("fault", 1);
    } else {
        std::thread::sleep(std::time::Duration::from_secs(4));
    }
    let states = daemon.stop();
    let faults = daemon.entries("fault");
    drop(robot);
    let lines = std::fs::read_to_string(&record).unwrap();
    let lines = lines.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let power_off_ns = lines.filter(|line| line["kind"] == "power").find_map(|line| line["mono_ns"].as_u64());
    Run { power_off_ns, faults, states }
}

/// A machine on which nothing is on time parts the two, too: then it is told so of a robot that nothing happened to, as well.
#[test]
fn the_model_finds_that_the_left_wheels_have_no_power() {
    for _ in 0..3 {
        let run = drive(Some("1"));
        let fault = &run.faults[0];
        let at_ns = fault["mono_ns"].as_u64().unwrap();
        if run.power_off_ns.is_none_or(|power_off_ns| at_ns < power_off_ns) {
            continue;
        }
        assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("board"), Some("model")), "{fault}");
        assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("stop"), Some("stopped")));
        let evidence = &fault["evidence"];
        assert_eq!(evidence["port"], "board.encoders");
        assert_eq!((evidence["field"].as_str(), evidence["window_ns"].as_u64()), (Some("ticks[0]"), Some(400_000_000)));
        let number = |name: &str| evidence[name].as_f64().unwrap();
        assert!(
            number("model") > number("target") && number("difference") > 800.0,
            "the wheel lags behind: {evidence}"
        );
        let state = |name: &str| run.states.iter().find(|slot| slot["slot"] == name).unwrap()["state"].clone();
        assert_eq!((state("board"), state("model")), ("error".into(), "active".into()));
        return;
    }
    let control = drive(None);
    assert!(!control.faults.is_empty(), "only before the power fails the two part");
    eprintln!("this machine is too busy to show it: {:?}", control.faults);
}

#[test]
fn the_model_says_nothing_of_wheels_that_do_what_they_are_told() {
    for _ in 0..3 {
        if drive(None).faults.is_empty() {
            return;
        }
    }
    panic!("the model and the board part though nothing failed");
}
