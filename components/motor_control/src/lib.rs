//! Motor control: wanted motion in, wheel velocities out.

use std::time::Duration;

use component_sdk::prelude::*;
use robot_objects::objects::seconds;
use robot_objects::{EncoderCounts, Motion, WheelCommand};

pub mod wheel_control;

use wheel_control::{Drive, WheelControl};

/// A command older than this counts as "stand still".
const COMMAND_LASTS: Duration = Duration::from_millis(200);

/// Turns a wanted motion into wheel velocities, within the limits of acceleration.
#[derive(Component)]
#[component(name = "MotorControl", version = "1.0", periodic = "20ms")]
pub struct MotorControl {
    /// The wanted motion.
    #[port]
    command: DataIn<Twist>,
    /// How the wheels really turned; may be left unconnected.
    #[port]
    encoders: DataIn<EncoderCounts>,
    /// How fast the wheels are to turn.
    #[port]
    wheels: DataOut<WheelCommand>,
    /// Distance between left and right wheels as it works when skidding.
    #[property(default = 0.412, unit = "m", range = 0.05..=3.0)]
    track: f64,
    /// Fastest gain of forward speed; braking may be three times as hard.
    #[property(default = 1.0, unit = "m/s^2", range = 0.05..=10.0)]
    max_acceleration: f64,
    /// Fastest gain of turn rate.
    #[property(default = 6.0, unit = "rad/s^2", range = 0.1..=50.0)]
    max_turn_acceleration: f64,
    /// How fast unequal motors are evened out; 0: not at all.
    #[property(default = 0.5, unit = "1/s", range = 0.0..=5.0)]
    trim_gain: f64,
    #[critical]
    control: WheelControl,
    last: Instant,
}

impl Callbacks for MotorControl {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let drive = self.drive();
        if let Some(reading) = self.encoders.fresh() {
            self.control.observe(reading.ticks, seconds(&reading.stamp), &drive);
        }
        let in_time = self.command.age(cx).is_some_and(|age| age <= COMMAND_LASTS);
        let wanted = self.command.newest().filter(|_| in_time).map_or(Motion::STOP, Motion::from);
        let elapsed = cx.now().since(self.last).as_secs_f64().clamp(0.001, 0.05);
        if let Some([left, right]) = self.control.drive(wanted, elapsed, &drive) {
            self.wheels.write(WheelCommand { left, right });
        }
        self.last = cx.now();
        Ok(())
    }

    fn stop(&mut self, _: &mut Context<'_>) -> Outcome {
        self.control.halt();
        self.wheels.write(WheelCommand::default());
        Ok(())
    }
}

impl MotorControl {
    fn drive(&self) -> Drive {
        Drive {
            track: self.track,
            max_acceleration: self.max_acceleration,
            max_turn_acceleration: self.max_turn_acceleration,
            trim_gain: self.trim_gain,
            ..Drive::default()
        }
    }
}

export_components!(MotorControl);
