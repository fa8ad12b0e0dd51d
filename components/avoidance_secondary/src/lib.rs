//! Obstacle avoidance by a potential field.

use std::time::Duration;

use board_protocol::robot::BODY_RADIUS_M;
use component_sdk::prelude::*;
use robot_objects::{Motion, UltrasonicRing};

pub mod field;
pub mod steering;

use steering::{Settings, Steering};

/// Echoes and courses older than this are not acted upon: a blind robot stands still.
const NEWS_LASTS: Duration = Duration::from_millis(400);

/// Steers as the course attracts and the echoes repel; along the wall where these cancel out.
#[derive(Component)]
#[component(name = "AvoidanceSecondary", version = "1.0", periodic = "20ms")]
pub struct AvoidanceSecondary {
    /// Filtered echoes.
    #[port]
    ranges: DataIn<UltrasonicRing>,
    /// Wanted speed and bearing (turn rate that would be on it within a second).
    #[port]
    course: DataIn<Twist>,
    /// The motion that is safe.
    #[port]
    command: DataOut<Twist>,
    /// Distance at which walls are followed, from the body.
    #[property(default = 0.15, unit = "m", range = 0.01..=1.0)]
    clearance: f64,
    /// Nothing moves forward with an obstacle ahead nearer to the body than this.
    #[property(default = 0.08, unit = "m", range = 0.02..=1.0)]
    stop_distance: f64,
    /// Fastest turn.
    #[property(default = 1.8, unit = "rad/s", range = 0.1..=6.0)]
    max_turn: f64,
    #[critical]
    steering: Steering,
}

impl Callbacks for AvoidanceSecondary {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        let settings = self.settings();
        let in_time = |age: Option<Duration>| age.is_some_and(|age| age <= NEWS_LASTS);
        let sees = in_time(self.ranges.age(cx)) && in_time(self.course.age(cx));
        let command = match (self.ranges.newest(), self.course.newest()) {
            (Some(ring), Some(course)) if sees => self.steering.steer(&ring.ranges, course.into(), &settings),
            _ => Motion::STOP,
        };
        self.command.write(command.into());
        Ok(())
    }
}

impl AvoidanceSecondary {
    fn settings(&self) -> Settings {
        Settings {
            clearance: self.clearance,
            stop_distance: self.stop_distance,
            body_radius: f64::from(BODY_RADIUS_M),
            max_turn: self.max_turn,
        }
    }
}

export_components!(AvoidanceSecondary);
