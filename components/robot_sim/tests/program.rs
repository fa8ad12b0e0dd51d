//! The program as a driver and a vision component meet it: a device, a socket, a record, an exit code.

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};

use board_protocol::{Command, Decoder, Encoder, Telemetry, WheelVelocities};
use robot_sim::serve::record::{Reason, Record};

/// Nothing here may hang for longer.
const PATIENCE: Duration = Duration::from_secs(20);

struct Simulator {
    process: Child,
    directory: tempfile::TempDir,
}

impl Simulator {
    fn start(options: &[&str]) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let mut process = Process::new(env!("CARGO_BIN_EXE_robot-sim"))
            .arg("--board")
            .arg(directory.path().join("board"))
            .arg("--camera")
            .arg(directory.path().join("camera"))
            .arg("--record")
            .arg(directory.path().join("record"))
            .args(options)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
        assert!(line.starts_with("ready board="), "{line}");
        Self { process, directory }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    fn exit_code(&mut self) -> i32 {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            if let Some(status) = self.process.try_wait().unwrap() {
                return status.code().expect("an exit code, not a signal");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("the simulator does not end");
    }

    fn terminate(&mut self) -> i32 {
        let pid = rustix::process::Pid::from_child(&self.process);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
        self.exit_code()
    }

    fn records(&self) -> Vec<Record> {
        let text = std::fs::read_to_string(self.path("record")).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ended = self.process.kill();
        let _ended = self.process.wait();
    }
}

/// A driver: opens the device like any serial port and listens until it has `count` encoder messages.
fn drive(device: &Path, speed: f32, count: usize) -> Vec<[i32; 4]> {
    let mut line = File::options().read(true).write(true).open(device).unwrap();
    let (mut encoder, mut decoder) = (Encoder::new(), Decoder::<Telemetry>::new());
    let (mut ticks, mut buffer) = (Vec::new(), [0; 512]);
    while ticks.len() < count {
        let speeds = WheelVelocities { left_rad_s: speed, right_rad_s: speed };
        line.write_all(&encoder.encode(&Command::WheelVelocities(speeds))).unwrap();
        let length = line.read(&mut buffer).unwrap();
        decoder.feed(&buffer[..length], |message| {
            if let Telemetry::Encoders(encoders) = message {
                ticks.push(encoders.ticks);
            }
        });
    }
    assert_eq!(decoder.counters().checksum_errors, 0);
    ticks
}

#[test]
fn a_driver_may_close_the_device_and_open_it_again() {
    let mut simulator = Simulator::start(&[]);
    let device = simulator.path("board");
    let first = drive(&device, 5.0, 30);
    assert!(first.last().unwrap()[0] > 100, "the wheels turn: {:?}", first.last());
    std::thread::sleep(Duration::from_millis(600));
    let second = drive(&device, 5.0, 10);
    let standing = second[0][0] - first.last().unwrap()[0];
    assert!((0..900).contains(&standing), "the watchdog stopped the robot meanwhile: {standing} ticks");
    assert_eq!(simulator.terminate(), 0);
    assert!(!device.exists(), "the link goes with the simulator");
}

#[test]
fn nobody_is_fed_the_past() {
    let simulator = Simulator::start(&[]);
    std::thread::sleep(Duration::from_millis(1500));
    let mut line = File::open(simulator.path("board")).unwrap();
    let mut buffer = [0; 8192];
    let waiting = line.read(&mut buffer).unwrap();
    assert!(waiting <= 700, "{waiting} bytes were waiting");
}

#[test]
fn camera_clients_come_and_go() {
    let simulator = Simulator::start(&[]);
    let idle = UnixStream::connect(simulator.path("camera")).unwrap();
    let first = frame(&mut UnixStream::connect(simulator.path("camera")).unwrap());
    let mut stream = UnixStream::connect(simulator.path("camera")).unwrap();
    let later: Vec<u32> = (0..5).map(|_| frame(&mut stream)).collect();
    assert!(later[0] > first);
    assert!(later.windows(2).all(|pair| pair[1] > pair[0]), "{later:?}");
    drop(idle);
}

fn frame(stream: &mut UnixStream) -> u32 {
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut header = [0; 24];
    stream.read_exact(&mut header).unwrap();
    let number = |at: usize| u32::from_le_bytes(header[at..at + 4].try_into().unwrap());
    assert_eq!((&header[..4], number(4), number(8)), (&b"FRAM"[..], 160, 120));
    stream.read_exact(&mut vec![0; 160 * 120 * 3]).unwrap();
    number(12)
}

#[test]
fn time_out_is_exit_code_1_and_the_record_says_so() {
    let mut simulator = Simulator::start(&["--timeout", "3", "--speed", "10"]);
    assert_eq!(simulator.exit_code(), 1);
    let records = simulator.records();
    assert!(matches!(&records[0], Record::Start { world, .. } if world.name == "warehouse"));
    assert!(records.len() > 60, "50 Hz or what the pace allows, got {}", records.len());
    assert!(matches!(records.last(), Some(Record::End(end)) if !end.reached && end.reason == Reason::Timeout));
}

#[test]
fn standing_near_the_target_is_exit_code_0() {
    let directory = tempfile::tempdir().unwrap();
    let world = directory.path().join("world.json");
    let text = include_str!("../worlds/warehouse.json").replace(r#""x": 0.8, "y": 2.5"#, r#""x": 8.4, "y": 2.5"#);
    std::fs::write(&world, text).unwrap();
    let mut simulator = Simulator::start(&["--world", world.to_str().unwrap()]);
    assert_eq!(simulator.exit_code(), 0);
    assert!(matches!(simulator.records().last(), Some(Record::End(end)) if end.reached));
}

#[test]
fn a_place_that_is_taken_is_refused_with_a_way_out() {
    let directory = tempfile::tempdir().unwrap();
    let board = directory.path().join("board");
    std::fs::write(&board, "precious").unwrap();
    let output = Process::new(env!("CARGO_BIN_EXE_robot-sim")).arg("--board").arg(&board).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("choose another path"));
    assert_eq!(std::fs::read_to_string(&board).unwrap(), "precious");
}
