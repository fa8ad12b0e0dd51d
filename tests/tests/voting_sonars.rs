//! Three redundant sonars of the simulated robot vote while it drives: one drifts, one falls silent.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use serde_json::Value;
use tempfile::TempDir;
use tests::profiles::plugin_dir;
use tests::running::Running;

/// The simulated robot with its three sonars, and the daemon that drives it.
struct Drive {
    daemon: Running,
    robot: Child,
    record: PathBuf,
    _place: TempDir,
}

impl Drive {
    fn start(faults: &[&str]) -> Self {
        let place = TempDir::new().unwrap();
        let file = |name: &str| place.path().join(name);
        let mut command = Command::new(plugin_dir().join("robot-sim"));
        command.arg("--board").arg(file("board")).arg("--record").arg(file("record.jsonl"));
        ["left", "middle", "right"]
            .iter()
            .for_each(|name| _ = command.arg("--sonar").arg(file(&format!("sonar-{name}"))));
        command.args(["--timeout", "1000", "--linger", "1000"]).args(faults).stdout(Stdio::piped());
        let mut robot = command.spawn().expect("the simulator is built");
        let mut lines = BufReader::new(robot.stdout.take().expect("piped")).lines();
        assert!(lines.any(|line| line.is_ok_and(|line| line.starts_with("ready "))), "the simulator gets ready");
        std::thread::spawn(move || lines.for_each(drop));
        let daemon = Running::start(&profiles(place.path()), &[]);
        Self { daemon, robot, record: file("record.jsonl"), _place: place }
    }

    /// What was really the case, the newest first.
    fn truth(&self) -> Vec<Value> {
        let text = std::fs::read_to_string(&self.record).unwrap_or_default();
        let lines = text.lines().rev().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        lines.filter(|line| line["kind"] == "truth").collect()
    }

    /// How far it has come since then, as the crow flies, in m.
    fn way_since(&self, mono_ns: u64) -> f64 {
        let truth = self.truth();
        let then = truth.iter().find(|moment| moment["mono_ns"].as_u64() <= Some(mono_ns));
        let (Some(now), Some(then)) = (truth.first(), then) else { return 0.0 };
        let along = |axis: &str| now[axis].as_f64().unwrap() - then[axis].as_f64().unwrap();
        along("x").hypot(along("y"))
    }

    /// Its wheels do not turn, and have not for half a second.
    fn stands(&self) -> bool {
        let still = |moment: &Value| {
            moment["wheels"].as_array().unwrap().iter().all(|wheel| wheel.as_f64().unwrap().abs() < 0.05)
        };
        let truth = self.truth();
        truth.len() > 25 && truth.iter().take(25).all(still)
    }

    fn has_hit_nothing(&self) -> bool {
        self.truth().first().is_some_and(|moment| moment["collisions"] == 0)
    }

    /// The first fault that this is true of.
    fn fault(&self, what: &str, is_it: impl Fn(&Value) -> bool) -> Value {
        self.daemon.until(what, || self.daemon.entries("fault").iter().any(&is_it));
        self.daemon.entries("fault").into_iter().find(is_it).unwrap()
    }
}

impl Drop for Drive {
    fn drop(&mut self) {
        let _ = self.robot.kill();
        let _ = self.robot.wait();
    }
}

fn profiles(place: &Path) -> PathBuf {
    let profiles = place.join("profile");
    std::fs::create_dir(&profiles).unwrap();
    let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/voting_sonars");
    for file in std::fs::read_dir(original).unwrap().map(Result::unwrap) {
        let text = std::fs::read_to_string(file.path()).unwrap();
        let text = text.replace("/tmp/robot-", &format!("{}/", place.display()));
        std::fs::write(profiles.join(file.file_name()), text).unwrap();
    }
    profiles
}

fn mono_ns(fault: &Value) -> u64 {
    fault["mono_ns"].as_u64().unwrap()
}

#[test]
fn one_that_drifts_is_outvoted_and_the_robot_drives_on() {
    let drive = Drive::start(&["--sonar-drift", "2@2"]);
    // One whose echo was missed where the distance leaps may be outvoted for a round, too; what drifts is too near.
    let number = |fault: &Value, name: &str| fault["evidence"][name].as_f64().unwrap_or(f64::NAN);
    let is_too_near = |fault: &Value| number(fault, "value") + 0.3 < number(fault, "agreed");
    let fault =
        drive.fault("the right one to be outvoted", |fault| fault["slot"] == "sonars.right" && is_too_near(fault));
    assert_eq!((fault["symptom"].as_str(), fault["outcome"].as_str()), (Some("vote"), Some("ignored")), "{fault}");
    let evidence = &fault["evidence"];
    assert_eq!((evidence["kind"].as_str(), evidence["port"].as_str()), (Some("vote"), Some("sonars.right.ranges")));
    assert_eq!((evidence["field"].as_str(), evidence["agreeing"].as_u64()), (Some("ranges[0]"), Some(2)));
    // Who believed it would stand before a wall that comes nearer by itself.
    drive.daemon.until("the robot to drive on", || drive.way_since(mono_ns(&fault)) > 2.0);
    assert!(drive.has_hit_nothing());
}

#[test]
fn one_falls_silent_and_one_drifts_and_where_no_two_agree_the_robot_stands() {
    let drive = Drive::start(&["--sonar-silent", "1@2", "--sonar-drift", "2@5"]);
    let silent = drive
        .fault("the middle one to be missed", |fault| fault["slot"] == "sonars.middle" && fault["symptom"] == "stale");
    assert_eq!(silent["evidence"]["port"], "sonars.middle.ranges", "{silent}");
    drive.daemon.until("the robot to drive on", || drive.way_since(mono_ns(&silent)) > 0.5);
    let few = drive.fault("the voter to have too few", |fault| fault["evidence"]["kind"] == "quorum");
    assert_eq!((few["slot"].as_str(), few["symptom"].as_str()), (Some("sonars.ring"), Some("vote")), "{few}");
    let evidence = &few["evidence"];
    assert_eq!((evidence["agreeing"].as_u64(), evidence["require"].as_u64()), (Some(1), Some(2)), "{evidence}");
    assert_eq!((few["action"].as_str(), few["outcome"].as_str()), (Some("stop"), Some("stopped")), "{few}");
    for (slot, reason) in [("avoider", "needs sonars.ring"), ("motors", "needs avoider")] {
        let is_it = |line: &Value| line["slot"] == slot && line["reason"] == reason;
        drive.daemon.until("nobody drives without the ring", || drive.daemon.entries("held").iter().any(is_it));
    }
    drive.daemon.until("the robot to stand", || drive.stands());
    assert!(drive.has_hit_nothing());
}
