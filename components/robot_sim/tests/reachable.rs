//! The default world does what the demo needs: a straight line collides, plain reactive avoidance arrives.

use std::time::Duration;

use board_protocol::robot::{RING, RING_STEP_RAD, TRACK_WIDTH_M, WHEEL_RADIUS_M};
use board_protocol::{Command, Telemetry, WheelVelocities};
use robot_sim::geometry::wrap;
use robot_sim::{Simulation, World};

fn drive(speed: f64, turn: f64) -> Command {
    let side = |sign: f64| ((speed + sign * turn * f64::from(TRACK_WIDTH_M) / 2.0) / f64::from(WHEEL_RADIUS_M)) as f32;
    Command::WheelVelocities(WheelVelocities { left_rad_s: side(-1.0), right_rad_s: side(1.0) })
}

/// Potential field on the ring alone, with the true bearing of the target: the least an avoider can do.
fn avoid(ring: [u16; RING], bearing: f64) -> Command {
    let (mut x, mut y) = (bearing.cos(), bearing.sin());
    let mut ahead: f64 = 3.0;
    for (index, range) in ring.iter().filter(|mm| **mm > 0).map(|mm| f64::from(*mm) / 1000.0).enumerate() {
        let angle = wrap(index as f64 * f64::from(RING_STEP_RAD));
        let push = (0.8 - range).max(0.0) * 2.2;
        x -= push * angle.cos();
        y -= push * angle.sin();
        if angle.abs() < 0.8 {
            ahead = ahead.min(range);
        }
    }
    let wanted = y.atan2(x);
    drive(0.45 * (ahead / 0.6).min(1.0) * (1.0 - wanted.abs() / 2.0).max(0.1), (2.0 * wanted).clamp(-1.5, 1.5))
}

fn run(seed: u64, mut steer: impl FnMut([u16; RING], f64) -> Command) -> Simulation {
    let mut robot = Simulation::new(World::warehouse(), seed);
    let mut ring = [0; RING];
    while robot.time() < Duration::from_secs(60) && !robot.reached() {
        let pose = robot.truth().pose;
        let bearing = wrap(pose.at.bearing(robot.world().target.at()) - pose.theta);
        robot.command(steer(ring, bearing));
        for message in robot.advance(Duration::from_millis(20)) {
            if let Telemetry::Ultrasonic(newest) = message {
                ring = newest.ranges_mm;
            }
        }
    }
    robot
}

#[test]
fn straight_at_the_target_collides() {
    let robot = run(1, |_, bearing| drive(0.45, 1.5 * bearing));
    assert!(robot.truth().collisions > 0);
}

#[test]
fn reactive_avoidance_arrives_in_time_without_a_collision() {
    for seed in 0..5 {
        let robot = run(seed, avoid);
        let truth = robot.truth();
        println!("seed {seed}: {:.1} s, {} collisions, {:?}", truth.time.as_secs_f64(), truth.collisions, truth.pose);
        assert!(robot.reached(), "seed {seed}: {truth:?}");
        assert_eq!(truth.collisions, 0, "seed {seed}");
        assert!((20.0..45.0).contains(&truth.time.as_secs_f64()), "seed {seed}: {:?}", truth.time);
    }
}
