//! The component on the bench: ports and properties.

use component_sdk::testing::Bench;
use robot_objects::UltrasonicRing;
use robot_objects::ring::ECHOES;
use ultrasonic::UltrasonicFilter;

fn ring(distance: f32) -> UltrasonicRing {
    UltrasonicRing { ranges: [distance; ECHOES], ..UltrasonicRing::default() }
}

fn filtered(bench: &mut Bench<UltrasonicFilter>, distance: f32) -> Option<f32> {
    bench.put("raw", ring(distance));
    bench.execute().expect("the filter has no errors");
    bench.take::<UltrasonicRing>("ranges").map(|ring| ring.ranges[0])
}

#[test]
fn every_round_gives_one_filtered_round() {
    let mut bench = Bench::<UltrasonicFilter>::new().expect("defaults are valid");
    let out: Vec<_> = [1.0, 1.0, 0.2, 1.0, 0.0].map(|distance| filtered(&mut bench, distance)).into();
    assert_eq!(out, [Some(1.0); 5]);
    bench.execute().expect("nothing new is no error");
    assert_eq!(bench.take::<UltrasonicRing>("ranges"), None);
}

#[test]
fn the_profile_sets_range_and_patience() {
    let mut bench = Bench::<UltrasonicFilter>::with(&[("max_range", "2.0"), ("hold", "0")]).expect("valid");
    assert_eq!(filtered(&mut bench, 2.5), Some(2.0));
    assert!(Bench::<UltrasonicFilter>::with(&[("max_range", "-1")]).is_err());
}
