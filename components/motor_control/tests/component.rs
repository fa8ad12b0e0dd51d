//! The component on the bench: commands in, wheel velocities out, silence stops.

use std::time::Duration;

use component_sdk::prelude::*;
use component_sdk::testing::Bench;
use motor_control::MotorControl;
use robot_objects::{Motion, WheelCommand};

const PERIOD: Duration = Duration::from_millis(20);

fn run(bench: &mut Bench<MotorControl>, periods: u32) -> WheelCommand {
    for _ in 0..periods {
        bench.advance(PERIOD);
        bench.execute().expect("motor control has no errors");
    }
    bench.take("wheels").expect("each period gives a command")
}

#[test]
fn a_command_is_followed_and_its_silence_ends_it() {
    let mut bench = Bench::<MotorControl>::new().expect("defaults are valid");
    assert_eq!(run(&mut bench, 5), WheelCommand::default());
    for _ in 0..50 {
        bench.put::<Twist>("command", Motion { forward: 0.5, turn: 0.0 }.into());
        bench.advance(PERIOD);
        bench.execute().expect("motor control has no errors");
    }
    let going = run(&mut bench, 1);
    assert!((going.left - 8.0).abs() < 1e-6 && (going.right - 8.0).abs() < 1e-6, "{going:?}");
    assert_eq!(run(&mut bench, 30), WheelCommand::default());
}

#[test]
fn stop_means_neutral() {
    let mut bench = Bench::<MotorControl>::new().expect("defaults are valid");
    bench.put::<Twist>("command", Motion { forward: 0.5, turn: 0.5 }.into());
    assert_ne!(run(&mut bench, 8), WheelCommand::default());
    bench.stop().expect("stopping has no errors");
    assert_eq!(bench.take("wheels"), Some(WheelCommand::default()));
}
