//! Reference model of the wheels: what they are told in, what their encoders should count out.

use std::time::Duration;

use component_sdk::prelude::*;
use robot_objects::objects::stamp_of_micros;
use robot_objects::{EncoderCounts, WheelCommand};

pub mod wheels;

use wheels::Wheels;

/// A wheel command older than this counts as "neutral", as it does for the board's driver.
const COMMAND_LASTS: Duration = Duration::from_millis(150);

/// Counts what the wheels should do.
#[derive(Component)]
#[component(name = "EncoderModel", version = "1.0", periodic = "20ms")]
pub struct EncoderModel {
    /// How fast the wheels are told to turn.
    #[port]
    wheels: DataIn<WheelCommand>,
    /// What the four encoders should count.
    #[port]
    expected: DataOut<EncoderCounts>,
    /// How long a wheel takes to come near a new speed.
    #[property(default = 0.04, unit = "s", range = 0.0..=5.0)]
    lag: f64,
    #[critical]
    model: Wheels,
    last: Instant,
}

impl Callbacks for EncoderModel {
    fn start(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.last = cx.now();
        Ok(())
    }

    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let now = cx.now();
        let in_time = self.wheels.age(cx).is_some_and(|age| age <= COMMAND_LASTS);
        let WheelCommand { left, right } = self.wheels.newest().filter(|_| in_time).copied().unwrap_or_default();
        self.model.advance([left, right], now.since(self.last).as_secs_f64(), self.lag);
        self.last = now;
        let stamp = stamp_of_micros(now.as_nanos() / 1000);
        self.expected.write(EncoderCounts { stamp, ticks: self.model.ticks() });
        Ok(())
    }
}

export_components!(EncoderModel);
