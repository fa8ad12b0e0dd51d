//! The component on the bench, with a board on the other end of a real pseudo-terminal.

use std::io::{ErrorKind, Read, Write};
use std::time::Duration;

use board_protocol::{Command, Decoder, Encoder, Encoders, Telemetry, Ultrasonic, WheelVelocities};
use component_sdk::object::CommObject;
use component_sdk::testing::Bench;
use motion_board::MotionBoard;
use robot_objects::{EncoderCounts, UltrasonicRing, WheelCommand};
use serialport::{SerialPort, TTYPort};

const PERIOD: Duration = Duration::from_millis(10);

/// The board's end of the line.
struct Board {
    line: TTYPort,
    encoder: Encoder,
    decoder: Decoder<Command>,
}

impl Board {
    /// A board, and the device that leads to it. The second port keeps the device alive.
    fn new() -> (Self, TTYPort, String) {
        let (mut line, device) = TTYPort::pair().expect("the system has pseudo-terminals");
        line.set_timeout(Duration::from_millis(60)).expect("a timeout can be set");
        let name = device.name().expect("it has a name");
        (Self { line, encoder: Encoder::new(), decoder: Decoder::new() }, device, name)
    }

    fn say(&mut self, telemetry: Telemetry) {
        let frame = self.encoder.encode(&telemetry);
        self.line.write_all(&frame).expect("the line takes a frame");
    }

    /// The last wheel velocities that have come. A pseudo-terminal delivers late and in pieces, so it listens until all is
    /// quiet.
    fn hear(&mut self) -> Option<WheelVelocities> {
        let (mut bytes, mut last) = ([0; 256], None);
        loop {
            match self.line.read(&mut bytes) {
                Ok(count) => self.decoder.feed(&bytes[..count], |command| {
                    if let Command::WheelVelocities(speeds) = command {
                        last = Some(speeds);
                    }
                }),
                Err(error) => {
                    assert_eq!(error.kind(), ErrorKind::TimedOut);
                    return last;
                }
            }
        }
    }
}

/// What comes out of a port, sooner or later.
fn wait_for<T: CommObject>(bench: &mut Bench<MotionBoard>, port: &str) -> T {
    for _ in 0..1000 {
        execute(bench);
        if let Some(object) = bench.take(port) {
            return object;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("nothing came out of `{port}`");
}

fn execute(bench: &mut Bench<MotionBoard>) {
    bench.advance(PERIOD);
    bench.execute().expect("a lost board is raised, not returned");
}

const NEUTRAL: Option<WheelVelocities> = Some(WheelVelocities { left_rad_s: 0.0, right_rad_s: 0.0 });

#[test]
fn commands_reach_the_board_and_stale_ones_become_neutral() {
    let (mut board, _device, name) = Board::new();
    let mut bench = Bench::<MotionBoard>::with(&[("device", &name)]).expect("valid");
    execute(&mut bench);
    assert_eq!(board.hear(), NEUTRAL, "without a command the wheels stand");
    bench.put("wheels", WheelCommand { left: 2.0, right: -3.0 });
    execute(&mut bench);
    assert_eq!(board.hear(), Some(WheelVelocities { left_rad_s: 2.0, right_rad_s: -3.0 }));
    bench.advance(Duration::from_millis(150));
    execute(&mut bench);
    assert_eq!(board.hear(), NEUTRAL);
    bench.put("wheels", WheelCommand { left: 2.0, right: 2.0 });
    execute(&mut bench);
    bench.stop().expect("the line is there");
    assert_eq!(board.hear(), NEUTRAL, "the last word at stop");
}

#[test]
fn the_stop_command_is_registered_while_the_line_is_open() {
    let (_board, _device, name) = Board::new();
    let mut bench = Bench::<MotionBoard>::with(&[("device", &name)]).expect("valid");
    for _ in 0..2 {
        execute(&mut bench);
        let outputs = Bench::<MotionBoard>::safe_outputs();
        assert_eq!(outputs.len(), 1);
        let mut seen = Vec::new();
        Decoder::<Command>::new().feed(&outputs[0].1, |command| seen.push(command));
        assert_eq!(seen, [Command::WheelVelocities(NEUTRAL.unwrap())]);
        bench.fail("something").expect("a reset closes the line");
        assert!(Bench::<MotionBoard>::safe_outputs().is_empty());
        // Long enough for the next attempt.
        bench.advance(Duration::from_secs(1));
    }
    execute(&mut bench);
    bench.stop().expect("the line is there");
    assert!(Bench::<MotionBoard>::safe_outputs().is_empty());
}

#[test]
fn telemetry_becomes_objects() {
    let (mut board, _device, name) = Board::new();
    let mut bench = Bench::<MotionBoard>::with(&[("device", &name)]).expect("valid");
    execute(&mut bench);
    board.say(Telemetry::Encoders(Encoders { time_us: 2_500_000, ticks: [1, 2, -3, 4] }));
    let counts: EncoderCounts = wait_for(&mut bench, "encoders");
    assert_eq!((counts.ticks, counts.stamp.sec, counts.stamp.nanosec), ([1, 2, -3, 4], 2, 500_000_000));
    board.say(Telemetry::Ultrasonic(Ultrasonic { time_us: 2_500_000, ranges_mm: [1500; 12] }));
    assert_eq!(wait_for::<UltrasonicRing>(&mut bench, "echoes").ranges, [1.5; 12]);
}

#[test]
fn a_board_that_hangs_up_is_one_fault_too() {
    let (board, device, name) = Board::new();
    let mut bench = Bench::<MotionBoard>::with(&[("device", &name)]).expect("valid");
    execute(&mut bench);
    drop((board, device));
    (0..100).for_each(|_| execute(&mut bench));
    assert_eq!(Bench::<MotionBoard>::device_news().len(), 1);
    assert_eq!(Bench::<MotionBoard>::lost_devices(), [name]);
    bench.stop().expect("nobody is left to be told");
}

#[test]
fn a_lost_board_is_one_fault_and_is_tried_again() {
    let mut bench = Bench::<MotionBoard>::with(&[("device", "/dev/not-there")]).expect("valid");
    (0..100).for_each(|_| execute(&mut bench));
    let news = Bench::<MotionBoard>::device_news();
    assert!(matches!(news.as_slice(), [one] if one.contains("/dev/not-there lost: ")), "{news:?}");
}

#[test]
fn a_board_that_falls_silent_is_lost_until_it_speaks() {
    let (mut board, _device, name) = Board::new();
    let mut bench = Bench::<MotionBoard>::with(&[("device", &name)]).expect("valid");
    (0..90).for_each(|_| execute(&mut bench));
    assert!(Bench::<MotionBoard>::device_news().is_empty(), "it may take a moment");
    (0..90).for_each(|_| execute(&mut bench));
    assert_eq!(Bench::<MotionBoard>::lost_devices(), std::slice::from_ref(&name));
    assert_eq!(board.hear(), NEUTRAL, "it may hear all the same");
    board.say(Telemetry::Encoders(Encoders { time_us: 1, ticks: [1; 4] }));
    let _: EncoderCounts = wait_for(&mut bench, "encoders");
    assert!(Bench::<MotionBoard>::lost_devices().is_empty());
    assert_eq!(Bench::<MotionBoard>::device_news().last(), Some(&format!("{name} found")));
}
