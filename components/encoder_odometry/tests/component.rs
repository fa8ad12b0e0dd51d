//! The component on the bench: ticks in, odometry out.

use std::f64::consts::TAU;

use component_sdk::prelude::*;
use component_sdk::testing::Bench;
use encoder_odometry::EncoderOdometry;
use robot_objects::EncoderCounts;
use robot_objects::objects::stamp_of_micros;

fn drive(bench: &mut Bench<EncoderOdometry>, ticks: [i32; 4], micros: u64) -> Odometry {
    bench.put("encoders", EncoderCounts { stamp: stamp_of_micros(micros), ticks });
    bench.execute().expect("odometry has no errors");
    bench.take("odometry").expect("a reading gives a report")
}

#[test]
fn a_revolution_of_all_wheels_is_their_circumference() {
    let mut bench = Bench::<EncoderOdometry>::new().expect("defaults are valid");
    drive(&mut bench, [0; 4], 0);
    let report = drive(&mut bench, [2000; 4], 1_000_000);
    assert!((report.pose.pose.position.x - TAU * 0.0625).abs() < 1e-4);
    assert!((report.twist.twist.linear.x - TAU * 0.0625).abs() < 1e-4);
    assert_eq!(&*report.header.frame_id, "odom");
    assert_eq!(report.header.stamp, Time { sec: 1, nanosec: 0 });
}

#[test]
fn right_wheels_alone_turn_it_left() {
    let mut bench = Bench::<EncoderOdometry>::with(&[("track", "0.4")]).expect("valid");
    drive(&mut bench, [0; 4], 0);
    let report = drive(&mut bench, [0, 0, 1000, 1000], 1_000_000);
    assert!((report.pose.pose.orientation.yaw() - TAU * 0.0625 / 2.0 / 0.4).abs() < 1e-3);
}
