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

/// Echoes as places around the robot's centre, x ahead, y left, in metres.
fn echoes(ring: [u16; RING]) -> Vec<(f64, f64)> {
    let heard = ring.iter().enumerate().filter(|(_, mm)| **mm > 0);
    let place = |(index, mm): (usize, &u16)| {
        let (angle, range) = (index as f64 * f64::from(RING_STEP_RAD), f64::from(*mm) / 1000.0 + 0.2);
        (range * angle.cos(), range * angle.sin())
    };
    heard.map(place).collect()
}

/// Drives into the free corridor nearest to the target's bearing: the least an avoider can do.
fn avoid(ring: [u16; RING], bearing: f64, last: &mut f64) -> Command {
    let echoes = echoes(ring);
    let free = |heading: f64| {
        echoes.iter().all(|(x, y)| {
            let along = x * heading.cos() + y * heading.sin();
            let aside = (y * heading.cos() - x * heading.sin()).abs();
            !(0.0..=1.1).contains(&along) || aside > 0.45
        })
    };
    let cost = |heading: &f64| (heading - bearing).abs() + 0.4 * (heading - *last).abs();
    let headings = (-36..=36).map(|step| f64::from(step) * 0.07).filter(|heading| free(*heading));
    let heading = headings.min_by(|a, b| cost(a).total_cmp(&cost(b)));
    *last = heading.unwrap_or(*last);
    heading.map_or(drive(0.0, 0.8), |heading| drive(0.45 * (1.0 - heading.abs()).max(0.1), 1.8 * heading))
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
        let mut last = 0.0;
        let robot = run(seed, |ring, bearing| avoid(ring, bearing, &mut last));
        let truth = robot.truth();
        println!("seed {seed}: {:.1} s, {} collisions, {:?}", truth.time.as_secs_f64(), truth.collisions, truth.pose);
        assert!(robot.reached(), "seed {seed}: {truth:?}");
        assert_eq!(truth.collisions, 0, "seed {seed}");
        assert!((20.0..45.0).contains(&truth.time.as_secs_f64()), "seed {seed}: {:?}", truth.time);
    }
}
