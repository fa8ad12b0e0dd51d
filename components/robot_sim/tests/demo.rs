//! The whole demo program, with a daemon that is played by this very test: it drives the robot over the real
//! pseudo-terminal and writes a journal, so that everything but the daemon is real.

mod common;

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use board_protocol::robot::{METRES_PER_TICK, TRACK_WIDTH_M};
use board_protocol::{Decoder, Encoder, Telemetry};
use common::avoid;
use robot_sim::World;
use robot_sim::geometry::{Pose, wrap};
use robot_sim::serve::mono_ns;

const ARGUMENTS: &str = "PLAYED_DAEMON_ARGUMENTS";

/// A short drive: from behind the last obstacles to the target.
const START: &str = r#""start": { "x": 8.0, "y": 3.4, "theta": -30 }"#;

struct Bench {
    directory: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self { directory: tempfile::tempdir().unwrap() };
        let world = include_str!("../worlds/warehouse.json");
        let start = world.find("\"start\"").unwrap();
        std::fs::write(bench.path("world.json"), format!("{}{START}\n}}\n", &world[..start])).unwrap();
        std::fs::create_dir(bench.path("profile")).unwrap();
        let application = r#"<application_profile><properties><property name="device">/dev/nowhere</property>
            <property name="socket">/nowhere</property></properties>
            <secondary reference="B.xml" preload="instance"/></application_profile>"#;
        std::fs::write(bench.path("profile/navigation.xml"), application).unwrap();
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// A program that calls this test binary as the daemon, in the manner `how`.
    fn daemon(&self, how: &str) -> PathBuf {
        let this = std::env::current_exe().unwrap();
        let script = format!(
            "#!/bin/sh\n{ARGUMENTS}=\"{how} $*\" exec {} played_daemon --exact --ignored --nocapture\n",
            this.display()
        );
        let path = self.path("daemon");
        std::fs::write(&path, script).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    fn demo(&self, how: &str, options: &[&str]) -> Output {
        self.command(how, options).output().unwrap()
    }

    fn command(&self, how: &str, options: &[&str]) -> Process {
        let mut command = Process::new(env!("CARGO_BIN_EXE_robot-demo"));
        command.arg("--profile").arg(self.path("profile")).arg("--out").arg(self.path("out"));
        command.arg("--world").arg(self.path("world.json")).arg("--daemon").arg(self.daemon(how));
        command.args(["--headless", "--timeout", "30"]).args(options);
        command
    }
}

fn last_line(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).lines().last().unwrap_or_default().to_owned()
}

#[test]
fn a_good_run_ends_with_the_promised_line_and_leaves_a_picture() {
    let bench = Bench::new();
    let output = bench.demo("drives", &["--inject", "avoider:crash.segv@0.5", "--inject", "sonar:crash.fpe@1"]);
    let line = last_line(&output);
    assert!(output.status.success(), "{output:?}");
    assert!(line.starts_with("target reached in ") && line.ends_with("faults 2, recovered 2, collisions 0"), "{line}");
    let picture = std::fs::read_to_string(bench.path("out/path.svg")).unwrap();
    assert!(picture.contains("avoider crash.segv"));
    let profile = std::fs::read_to_string(bench.path("out/profile/navigation.xml")).unwrap();
    assert!(!profile.contains("/dev/nowhere") && profile.contains(r#"preload="instance""#), "{profile}");
}

#[test]
fn a_daemon_that_dies_is_reported_and_nothing_is_left_running() {
    let bench = Bench::new();
    let output = bench.demo("dies", &["--faults", "none"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1));
    assert!(text.contains("the daemon ended on the way"), "{text}");
    assert!(last_line(&output).starts_with("target not reached after "), "{text}");
}

#[test]
fn a_daemon_that_never_gets_ready_shows_its_last_words() {
    let output = Bench::new().demo("refuses", &[]);
    assert_eq!(output.status.code(), Some(2));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(errors.contains("ended before it was ready") && errors.contains("cannot find its plugins"), "{errors}");
}

#[test]
fn a_signal_ends_everything_that_was_started() {
    let bench = Bench::new();
    let mut demo = bench.command("waits", &[]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let pid = rustix::process::Pid::from_child(&demo);
    let mut lines = BufReader::new(demo.stdout.take().unwrap()).lines();
    assert!(lines.any(|line| line.unwrap().contains("daemon ready")));
    let short = std::env::temp_dir().join(format!("robot-demo-{}", demo.id()));
    assert!(short.join("board").exists());
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let output = demo.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("interrupted"), "{output:?}");
    assert!(!short.exists(), "the simulator's places are gone");
    assert!(bench.path("out/profile/ended").exists(), "the daemon was asked to end");
}

#[test]
fn the_comparison_runs_three_times_with_three_profiles() {
    let bench = Bench::new();
    let output = bench.demo("drives", &["--compare-preload", "--inject", "avoider:crash.segv@0.5"]);
    assert!(output.status.success(), "{output:?}");
    for preload in ["none", "library", "instance"] {
        let profile = bench.path(&format!("out/preload-{preload}/profile/navigation.xml"));
        assert!(std::fs::read_to_string(profile).unwrap().contains(&format!(r#"preload="{preload}""#)));
    }
    assert!(last_line(&output).ends_with("faults 3, recovered 3, collisions 0"), "{output:?}");
}

/// Not a test: the daemon, when the demo starts this binary as one.
#[test]
#[ignore = "played by the demo in the other tests"]
fn played_daemon() {
    let Ok(arguments) = std::env::var(ARGUMENTS) else { return };
    let mut words = arguments.split(' ');
    let how = words.next().unwrap();
    if how == "refuses" {
        eprintln!("cannot find its plugins");
        std::process::exit(4);
    }
    println!("\nready");
    if how == "dies" {
        std::thread::sleep(Duration::from_millis(500));
        std::process::exit(1);
    }
    if how == "waits" {
        return wait(words.nth(1).unwrap());
    }
    drive(&words.map(String::from).collect::<Vec<_>>());
}

/// Does nothing until SIGTERM, and leaves a sign that it came.
fn wait(profile: &str) {
    let stop = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGTERM, Arc::clone(&stop)).unwrap();
    while !stop.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(5));
    }
    File::create(Path::new(profile).join("ended")).unwrap();
}

fn drive(arguments: &[String]) {
    let after = |name: &str| arguments.iter().skip_while(move |word| *word != name).nth(1).unwrap();
    let profile = std::fs::read_to_string(Path::new(after("run")).join("navigation.xml")).unwrap();
    let device = profile.split("name=\"device\">").nth(1).unwrap().split('<').next().unwrap();
    let mut line = File::options().read(true).write(true).open(device).unwrap();
    let mut journal = File::create(after("--journal")).unwrap();
    let mut pending: Vec<&String> = arguments.iter().filter(|word| word.contains('@')).collect();
    let stop = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGTERM, Arc::clone(&stop)).unwrap();
    let (begin, mut pilot) = (Instant::now(), Pilot::new());
    let (mut encoder, mut decoder, mut buffer) = (Encoder::new(), Decoder::<Telemetry>::new(), [0; 512]);
    while !stop.load(Ordering::Relaxed) {
        let length = line.read(&mut buffer).unwrap();
        decoder.feed(&buffer[..length], |message| pilot.hear(message));
        line.write_all(&encoder.encode(&pilot.steer())).unwrap();
        pending.retain(|fault| {
            let due = begin.elapsed().as_secs_f64() >= fault.rsplit('@').next().unwrap().parse().unwrap();
            if due {
                journal.write_all(entry(fault).as_bytes()).unwrap();
            }
            !due
        });
    }
    std::process::exit(0);
}

fn entry(fault: &str) -> String {
    let (slot, symptom) = fault.split_once(':').unwrap();
    let symptom = symptom.split('@').next().unwrap();
    let now = mono_ns();
    let times = r#"{"detected_ns":1500,"decided_ns":1700,"ready_ns":1900,"first_callback_ns":2400}"#;
    format!(
        r#"{{"kind":"fault","seq":{now},"mono_ns":{now},"slot":"{slot}","class":"A","symptom":"{symptom}","evidence":{{}},"action":"replace","successor":"B","outcome":"recovered","times":{times},"injected":true,"crc":"0"}}"#
    ) + "\n"
}

/// Odometry from the encoders and the least of avoiders.
struct Pilot {
    pose: Pose,
    ticks: Option<[i32; 4]>,
    ring: [u16; 12],
    heading: f64,
}

impl Pilot {
    fn new() -> Self {
        let pose =
            serde_json::from_str::<robot_sim::world::Start>(START.trim_start_matches("\"start\": ")).unwrap().pose();
        Self { pose, ticks: None, ring: [0; 12], heading: 0.0 }
    }

    fn hear(&mut self, message: Telemetry) {
        match message {
            Telemetry::Ultrasonic(ring) => self.ring = ring.ranges_mm,
            Telemetry::Encoders(encoders) => {
                let before = self.ticks.replace(encoders.ticks).unwrap_or(encoders.ticks);
                let way = |wheel: usize| f64::from(encoders.ticks[wheel] - before[wheel]) * f64::from(METRES_PER_TICK);
                self.pose.theta = wrap(self.pose.theta + (way(2) - way(0)) / f64::from(TRACK_WIDTH_M));
                self.pose.at = self.pose.at.towards(self.pose.theta, f64::midpoint(way(0), way(2)));
            }
            Telemetry::Status(_) => {}
        }
    }

    fn steer(&mut self) -> board_protocol::Command {
        let bearing = wrap(self.pose.at.bearing(World::warehouse().target.at()) - self.pose.theta);
        avoid(self.ring, bearing, &mut self.heading)
    }
}
