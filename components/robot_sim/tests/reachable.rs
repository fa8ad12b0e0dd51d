//! The default world does what the demo needs: a straight line collides, plain reactive avoidance arrives.

mod common;

use std::time::Duration;

use board_protocol::robot::RING;
use board_protocol::{Command, Telemetry};
use common::{avoid, drive};
use robot_sim::geometry::wrap;
use robot_sim::{Simulation, World};

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
