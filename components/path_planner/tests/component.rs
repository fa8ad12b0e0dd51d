//! The component on the bench: odometry and sightings in, course out.

use std::time::Duration;

use component_sdk::prelude::*;
use component_sdk::testing::Bench;
use path_planner::PathPlanner;
use robot_objects::{Detection, Motion};

fn course(bench: &mut Bench<PathPlanner>) -> Motion {
    bench.execute().expect("the planner has no errors");
    Motion::from(&bench.take::<Twist>("course").expect("each period gives a course"))
}

fn at(bench: &mut Bench<PathPlanner>, x: f64) {
    let mut odometry = Odometry::default();
    odometry.pose.pose.position.x = x;
    bench.put("odometry", odometry);
}

#[test]
fn without_odometry_there_is_no_course() {
    let mut bench = Bench::<PathPlanner>::with(&[("goal_known", "true"), ("goal_x", "4")]).expect("valid");
    assert_eq!(course(&mut bench), Motion::STOP);
    at(&mut bench, 0.0);
    assert!(course(&mut bench).forward > 0.4);
    bench.advance(Duration::from_secs(1));
    assert_eq!(course(&mut bench), Motion::STOP);
}

#[test]
fn it_goes_where_the_target_is_seen_and_says_so() {
    let mut bench = Bench::<PathPlanner>::new().expect("defaults are valid");
    at(&mut bench, 0.0);
    bench.put("target", Detection { found: true, bearing: 0.4, distance: 3.0, ..Detection::default() });
    assert!((course(&mut bench).bearing() - 0.4).abs() < 1e-6);
    bench.put("target", Detection::default());
    assert!((course(&mut bench).bearing() - 0.4).abs() < 1e-6, "an image without the target changes nothing");
    let logs = Bench::<PathPlanner>::logs();
    assert_eq!(logs, [(Level::Info, "on the way to the target".to_owned())]);
}
