//! The component on the bench: commands in, expected counts out.

use component_sdk::testing::Bench;
use encoder_model::EncoderModel;
use robot_objects::{EncoderCounts, WheelCommand};

#[test]
fn without_a_command_nothing_is_expected_to_turn() {
    let mut bench = Bench::<EncoderModel>::new().expect("defaults are valid");
    bench.execute().expect("the model has no errors");
    assert_eq!(bench.take::<EncoderCounts>("expected").expect("it always says something").ticks, [0; 4]);
}

#[test]
fn what_is_told_is_expected_of_its_own_side() {
    let mut bench = Bench::<EncoderModel>::with(&[("lag", "0.0")]).expect("valid");
    let mut last = [0; 4];
    for _ in 0..50 {
        bench.put("wheels", WheelCommand { left: 0.0, right: 1000.0 });
        bench.execute().expect("the model has no errors");
        while let Some(EncoderCounts { ticks, .. }) = bench.take("expected") {
            last = ticks;
        }
    }
    assert_eq!((last[0], last[1]), (0, 0));
    assert!(last[2] >= 0 && last[2] == last[3], "{last:?}");
}
