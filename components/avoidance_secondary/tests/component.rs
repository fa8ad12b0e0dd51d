//! The component on the bench: what it does without news, and with.

use std::time::Duration;

use avoidance_secondary::AvoidanceSecondary;
use component_sdk::prelude::*;
use component_sdk::testing::Bench;
use robot_objects::ring::ECHOES;
use robot_objects::{Motion, UltrasonicRing};

fn command(bench: &mut Bench<AvoidanceSecondary>) -> Motion {
    bench.execute().expect("avoidance has no errors");
    Motion::from(&bench.take::<Twist>("command").expect("each period gives a command"))
}

fn news(bench: &mut Bench<AvoidanceSecondary>, ahead: f32) {
    let mut ranges = [3.0; ECHOES];
    ranges[0] = ahead;
    bench.put("ranges", UltrasonicRing { ranges, ..UltrasonicRing::default() });
    bench.put::<Twist>("course", Motion::course(0.5, 0.0).into());
}

#[test]
fn it_follows_the_course_where_nothing_is_in_the_way() {
    let mut bench = Bench::<AvoidanceSecondary>::new().expect("defaults are valid");
    news(&mut bench, 3.0);
    assert!((command(&mut bench).forward - 0.5).abs() < 1e-9);
}

#[test]
fn it_stands_still_while_it_is_blind() {
    let mut bench = Bench::<AvoidanceSecondary>::new().expect("defaults are valid");
    assert_eq!(command(&mut bench), Motion::STOP);
    news(&mut bench, 3.0);
    bench.advance(Duration::from_secs(1));
    assert_eq!(command(&mut bench), Motion::STOP);
}

#[test]
fn nothing_moves_forward_within_the_stop_distance() {
    let mut bench = Bench::<AvoidanceSecondary>::with(&[("stop_distance", "0.3")]).expect("valid");
    news(&mut bench, 0.3);
    assert!(command(&mut bench).forward.abs() < 1e-9);
}
