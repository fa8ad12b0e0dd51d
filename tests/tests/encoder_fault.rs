//! Emergency stop on an encoder fault, on the simulated robot: its wheels turn, the encoders go mad, and the bytes that stop
//! the wheels leave the serial port.

use std::io::{ErrorKind, Read, Write};
use std::path::Path;
use std::process::{Child, Command as Process, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use board_protocol::{Command, Decoder, Encoder, Telemetry, WheelVelocities};
use serde_json::Value;
use serialport::{SerialPort, TTYPort};
use tempfile::TempDir;
use tests::asking::ask;
use tests::profiles::plugin_dir;
use tests::running::Running;

/// The line between driver and board, with an ear on what the driver says, and a way to make the encoders mad.
struct Line {
    _device: TTYPort,
    name: String,
    said: Arc<Mutex<Vec<WheelVelocities>>>,
    mad: Arc<AtomicBool>,
    over: Arc<AtomicBool>,
}

impl Line {
    fn to(board: &Path) -> Self {
        let (driver, device) = TTYPort::pair().expect("the system has pseudo-terminals");
        let open =
            serialport::new(board.to_string_lossy(), 115_200).timeout(Duration::from_millis(20)).exclusive(false);
        let board = open.open_native().expect("the board is there");
        let name = device.name().expect("it has a name");
        let line = Self { _device: device, name, said: Arc::default(), mad: Arc::default(), over: Arc::default() };
        let ends = (copy(&driver), copy(&board));
        line.carry_commands(driver, ends.1);
        line.carry_telemetry(board, ends.0);
        line
    }

    fn carry_commands(&self, mut from: TTYPort, mut to: TTYPort) {
        let (said, over) = (Arc::clone(&self.said), Arc::clone(&self.over));
        thread::spawn(move || {
            let mut decoder = Decoder::<Command>::new();
            carry(&mut from, &over, |bytes| {
                decoder.feed(bytes, |command| {
                    if let Command::WheelVelocities(speeds) = command {
                        said.lock().unwrap().push(speeds);
                    }
                });
                let _ = to.write_all(bytes);
            });
        });
    }

    fn carry_telemetry(&self, mut from: TTYPort, mut to: TTYPort) {
        let (mad, over) = (Arc::clone(&self.mad), Arc::clone(&self.over));
        thread::spawn(move || {
            let (mut decoder, mut encoder) = (Decoder::<Telemetry>::new(), Encoder::new());
            carry(&mut from, &over, |bytes| {
                decoder.feed(bytes, |mut message| {
                    if let Telemetry::Encoders(reading) = &mut message
                        && mad.load(Ordering::SeqCst)
                    {
                        reading.ticks[2] = i32::MAX;
                    }
                    let _ = to.write_all(&encoder.encode(&message));
                });
            });
        });
    }

    fn said(&self) -> Vec<WheelVelocities> {
        self.said.lock().unwrap().clone()
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
    }
}

fn copy(port: &TTYPort) -> TTYPort {
    port.try_clone_native().expect("a descriptor can be copied")
}

fn carry(from: &mut TTYPort, over: &AtomicBool, mut take: impl FnMut(&[u8])) {
    let _ = from.set_timeout(Duration::from_millis(20));
    let mut buffer = [0; 512];
    while !over.load(Ordering::SeqCst) {
        match from.read(&mut buffer) {
            Ok(length) => take(&buffer[..length]),
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            // Nobody has the other end open at this moment.
            Err(_) => thread::sleep(Duration::from_millis(5)),
        }
    }
}

const fn turns(speeds: &WheelVelocities) -> bool {
    speeds.left_rad_s != 0.0 || speeds.right_rad_s != 0.0
}

/// The simulator, ended with the test.
struct Simulator(Child);

impl Simulator {
    fn start(place: &Path) -> Self {
        let mut process = Process::new(plugin_dir().join("robot-sim"));
        for (option, name) in [("--board", "board"), ("--camera", "camera"), ("--record", "record")] {
            process.arg(option).arg(place.join(name));
        }
        let child = process.args(["--timeout", "600"]).stdout(Stdio::null()).spawn().expect("the simulator is built");
        let began = Instant::now();
        while !place.join("board").exists() {
            assert!(began.elapsed() < Duration::from_secs(60), "the simulator does not come up");
            thread::sleep(Duration::from_millis(5));
        }
        Self(child)
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The navigation robot, whose board is an actuator and whose encoders have limits.
fn profiles(line: &Line, place: &Path) -> std::path::PathBuf {
    let profiles = place.join("profile");
    std::fs::create_dir(&profiles).unwrap();
    let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/navigation");
    for file in std::fs::read_dir(original).unwrap().map(Result::unwrap) {
        let mut text = std::fs::read_to_string(file.path()).unwrap();
        let mut replace = |from: &str, to: &str| {
            assert!(text.contains(from), "{from} in {}", file.path().display());
            text = text.replacen(from, to, 1);
        };
        match file.file_name().to_str().unwrap() {
            "navigation.xml" => {
                replace("/tmp/robot-board", &line.name);
                replace("/tmp/robot-camera", &place.join("camera").to_string_lossy());
                replace(
                    "<severity symptom=\"device\">ignore</severity>",
                    "<severity symptom=\"device\">ignore</severity><severity symptom=\"validity\">emergency</severity>",
                );
            }
            "MotionBoard.xml" => replace(
                "<data_type>EncoderCounts</data_type>",
                "<data_type>EncoderCounts</data_type>\
                 <validity field=\"ticks\"><min>-1000000000</min><max>1000000000</max></validity>",
            ),
            "system.xml" => {
                replace("<plugins>../../target/release</plugins>", "");
                replace("</system_profile>", "<emergency><actuator component=\"board\"/></emergency></system_profile>");
            }
            _ => {}
        }
        std::fs::write(profiles.join(file.file_name()), text).unwrap();
    }
    profiles
}

/// How fast the wheels really turn, at the fastest, in the newest record.
fn truth(place: &Path) -> Option<f64> {
    let text = std::fs::read_to_string(place.join("record")).ok()?;
    let moments = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let newest = moments.rev().find(|line| line["kind"] == "truth")?;
    newest["wheels"].as_array()?.iter().filter_map(Value::as_f64).map(f64::abs).reduce(f64::max)
}

#[test]
fn mad_encoders_stop_the_wheels_through_the_serial_port() {
    let place = TempDir::new().unwrap();
    let _simulator = Simulator::start(place.path());
    let line = Line::to(&place.path().join("board"));
    let daemon = Running::start(&profiles(&line, place.path()), &[]);
    daemon.until("the wheels turn", || truth(place.path()).is_some_and(|speed| speed > 0.5));

    line.mad.store(true, Ordering::SeqCst);
    daemon.until("the emergency stop", || daemon.entries("emergency").len() >= 2);
    let fault = daemon.journal("fault", 1).into_iter().find(|fault| fault["action"] == "emergency").unwrap();
    assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("board"), Some("validity")), "{fault}");
    let raised = daemon.entries("emergency").remove(0);
    assert_eq!((raised["step"].as_str(), raised["outputs"].as_u64()), (Some("raised"), Some(1)), "{raised}");
    assert_eq!(raised["root"], fault["seq"]);

    daemon.until("the wheels' stop on the line", || line.said().last().is_some_and(|speeds| !turns(speeds)));
    daemon.until("the robot at rest", || truth(place.path()).is_some_and(|speed| speed < 0.05));
    let before = line.said();
    thread::sleep(Duration::from_millis(300));
    let since = line.said().split_off(before.len());
    assert!(since.iter().all(|speeds| !turns(speeds)), "it stays at rest: {since:?}");
    assert_eq!(ask(&daemon, "component reset board").code, Some(7));

    line.mad.store(false, Ordering::SeqCst);
    let cleared = ask(&daemon, "fault clear");
    assert_eq!((cleared.code, cleared.out.lines().last()), (Some(0), Some("board: active")), "{cleared:?}");
    // What was on the line by then may be mad still: then it is latched anew.
    daemon.until("the wheels turn again", || {
        let _ = ask(&daemon, "fault clear");
        truth(place.path()).is_some_and(|speed| speed > 0.5)
    });
}
