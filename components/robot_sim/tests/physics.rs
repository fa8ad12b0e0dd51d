//! The robot moves as a robot of this build would.

use std::f64::consts::TAU;
use std::time::Duration;

use board_protocol::robot::{TICKS_PER_REVOLUTION, WHEEL_RADIUS_M};
use board_protocol::{Command, DriverPower, StatusFlags, Telemetry, WheelVelocities};
use robot_sim::robot::TURNING_SLIP;
use robot_sim::{Simulation, World};

const STEP: Duration = Duration::from_millis(20);

/// A room of 20 x 20 m with nothing but the target in a corner; the robot in the middle, looking right.
fn open_room() -> Simulation {
    let world = World::parse(
        r#"{ "name": "open", "walls": [[[-10,-10],[10,-10],[10,10],[-10,10],[-10,-10]]], "wall_height": 1.0,
             "obstacles": [], "target": { "x": 9, "y": 9, "radius": 0.2, "height": 1, "colour": [255,0,0] },
             "start": { "x": 0, "y": 0, "theta": 0 } }"#,
    );
    Simulation::new(world.unwrap(), 1)
}

fn speeds(left_rad_s: f32, right_rad_s: f32) -> Command {
    Command::WheelVelocities(WheelVelocities { left_rad_s, right_rad_s })
}

/// Repeats `command` every 20 ms for `seconds`; all telemetry of that time.
fn hold(robot: &mut Simulation, command: Command, seconds: f64) -> Vec<Telemetry> {
    let end = robot.time() + Duration::from_secs_f64(seconds);
    let mut telemetry = Vec::new();
    while robot.time() < end {
        robot.command(command);
        telemetry.extend(robot.advance(STEP));
    }
    telemetry
}

fn last_ticks(telemetry: &[Telemetry]) -> [i32; 4] {
    let newest = telemetry.iter().rev().find_map(|message| match message {
        Telemetry::Encoders(encoders) => Some(encoders.ticks),
        _ => None,
    });
    newest.expect("encoders at 50 Hz")
}

fn last_flags(telemetry: &[Telemetry]) -> StatusFlags {
    let newest = telemetry.iter().rev().find_map(|message| match message {
        Telemetry::Status(status) => Some(status.flags),
        _ => None,
    });
    newest.expect("status at 10 Hz")
}

#[test]
fn a_straight_run_goes_straight_and_the_encoders_agree() {
    let mut robot = open_room();
    let telemetry = hold(&mut robot, speeds(6.4, 6.4), 5.0);
    let pose = robot.truth().pose;
    assert!((pose.at.x - 1.97).abs() < 0.05, "0.4 m/s for 5 s less the start, got {}", pose.at.x);
    assert!(pose.at.y.abs() < 1e-9 && pose.theta.abs() < 1e-9);
    let rolled = TAU * f64::from(WHEEL_RADIUS_M) / f64::from(TICKS_PER_REVOLUTION);
    for ticks in last_ticks(&telemetry) {
        assert!((f64::from(ticks) * rolled - pose.at.x).abs() < 0.001);
    }
}

#[test]
fn opposite_wheels_spin_in_place() {
    let mut robot = open_room();
    hold(&mut robot, speeds(-3.2, 3.2), 1.0);
    let pose = robot.truth().pose;
    assert!(pose.at.x.hypot(pose.at.y) < 0.001);
    let wanted = 0.4 / (0.4 * TURNING_SLIP);
    assert!((pose.theta - wanted).abs() < 0.15 && pose.theta < wanted, "{}", pose.theta);
}

#[test]
fn without_power_on_one_side_it_turns_about_that_side() {
    let mut robot = open_room();
    hold(&mut robot, Command::DriverPower(DriverPower { left: false, right: true }), 0.02);
    let telemetry = hold(&mut robot, speeds(4.0, 4.0), 1.0);
    let truth = robot.truth();
    assert_eq!(last_ticks(&telemetry)[0], 0);
    assert!(last_ticks(&telemetry)[2] > 1000);
    assert!(truth.pose.theta > 0.4, "{}", truth.pose.theta);
    assert!(!last_flags(&telemetry).contains(StatusFlags::LEFT_POWER));
    assert!(last_flags(&telemetry).contains(StatusFlags::RIGHT_POWER));
}

#[test]
fn power_that_fails_stops_the_left_wheels_and_the_board_does_not_tell() {
    let mut robot = open_room();
    robot.cut_left_power_after(Duration::from_secs(1));
    hold(&mut robot, speeds(0.0, 0.0), 0.5);
    let before = hold(&mut robot, speeds(6.0, 6.0), 0.98);
    assert!(robot.left_power_off().is_none());
    let after = hold(&mut robot, speeds(6.0, 6.0), 0.5);
    assert_eq!(robot.left_power_off(), Some(Duration::from_millis(1500)));
    let [left, _, right, _] = robot.truth().wheels_rad_s;
    assert!(left.abs() < 0.01 && right > 5.5, "{left} {right}");
    assert!(last_ticks(&after)[2] > last_ticks(&before)[2]);
    assert!(last_flags(&after).contains(StatusFlags::LEFT_POWER));
}

#[test]
fn it_stops_by_itself_when_commands_cease() {
    let mut robot = open_room();
    hold(&mut robot, speeds(6.4, 6.4), 1.0);
    robot.advance(Duration::from_millis(180));
    assert!(robot.truth().wheels_rad_s[0] > 6.0, "still within the watchdog's time");
    let telemetry = robot.advance(Duration::from_millis(400));
    assert!(robot.truth().wheels_rad_s[0].abs() < 0.01);
    assert!(last_flags(&telemetry).contains(StatusFlags::WATCHDOG));
    let telemetry = hold(&mut robot, speeds(6.4, 6.4), 0.5);
    assert!(robot.truth().wheels_rad_s[0] > 6.0, "the next command ends it");
    assert!(!last_flags(&telemetry).contains(StatusFlags::WATCHDOG));
}

#[test]
fn an_emergency_stop_is_latched_until_released() {
    let mut robot = open_room();
    hold(&mut robot, speeds(6.4, 6.4), 1.0);
    robot.command(Command::EmergencyStop);
    let telemetry = hold(&mut robot, speeds(6.4, 6.4), 1.0);
    assert!(robot.truth().wheels_rad_s[0].abs() < 0.01);
    assert!(last_flags(&telemetry).contains(StatusFlags::EMERGENCY));
    robot.command(Command::Release);
    robot.advance(Duration::from_millis(100));
    assert!(robot.truth().wheels_rad_s[0].abs() < 0.01, "stands until the next set point");
    hold(&mut robot, speeds(6.4, 6.4), 0.5);
    assert!(robot.truth().wheels_rad_s[0] > 6.0);
}

#[test]
fn a_wall_stops_the_body_and_counts_once() {
    let mut robot = open_room();
    hold(&mut robot, speeds(16.0, 16.0), 13.0);
    let truth = robot.truth();
    assert!((truth.pose.at.x - 9.75).abs() < 0.001, "{}", truth.pose.at.x);
    assert_eq!(truth.collisions, 1);
    let telemetry = hold(&mut robot, speeds(-5.0, -5.0), 1.0);
    assert!(!last_flags(&telemetry).contains(StatusFlags::BUMPER));
    hold(&mut robot, speeds(5.0, 5.0), 2.0);
    assert_eq!(robot.truth().collisions, 2);
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let run = |seed| {
        let mut robot = Simulation::new(World::warehouse(), seed);
        let telemetry = hold(&mut robot, speeds(3.0, 4.0), 2.0);
        (telemetry, robot.camera_frame())
    };
    assert_eq!(run(7), run(7));
    assert_ne!(run(7), run(8));
}

#[test]
fn uneven_steps_add_up_to_the_same_time() {
    let mut robot = open_room();
    (0..1000).for_each(|_| drop(robot.advance(Duration::from_nanos(1_234_567))));
    assert_eq!(robot.time(), Duration::from_millis(1234));
}
