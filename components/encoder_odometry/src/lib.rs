//! Encoder odometry: ticks in, position and speed out.

use component_sdk::prelude::*;
use robot_objects::EncoderCounts;
use robot_objects::motion::Motion;
use robot_objects::objects::seconds;

pub mod odometer;

use odometer::{Drive, Odometer};

/// Dead reckoning from the wheel encoders.
#[derive(Component)]
#[component(name = "EncoderOdometry", version = "1.0", nonperiodic)]
pub struct EncoderOdometry {
    /// Readings of the four encoders.
    #[port]
    encoders: DataIn<EncoderCounts>,
    /// Position and heading relative to the start, and speed.
    #[port]
    odometry: DataOut<Odometry>,
    /// Distance between left and right wheels as it works when skidding: a little more than measured.
    #[property(default = 0.412, unit = "m", range = 0.05..=3.0)]
    track: f64,
    /// Fastest believable speed; a faster step is taken for a restart of the board.
    #[property(default = 5.0, unit = "m/s", range = 0.1..=50.0)]
    top_speed: f64,
    #[critical]
    odometer: Odometer,
}

impl Callbacks for EncoderOdometry {
    fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
        let drive = Drive { track: self.track, top_speed: self.top_speed, ..Drive::default() };
        if let Some(reading) = self.encoders.fresh() {
            self.odometer.advance(reading.ticks, seconds(&reading.stamp), &drive);
            let mut report = self.odometry.loan();
            fill(&mut report, &self.odometer, reading.stamp);
            report.send();
        }
        Ok(())
    }
}

fn fill(report: &mut Odometry, at: &Odometer, stamp: Time) {
    report.header.stamp = stamp;
    report.header.frame_id.set("odom");
    report.child_frame_id.set("base_link");
    report.pose.pose.position = Point { x: at.x, y: at.y, z: 0.0 };
    report.pose.pose.orientation = Quaternion::from_yaw(at.heading);
    report.twist.twist = Motion { forward: at.forward, turn: at.turn }.into();
}

export_components!(EncoderOdometry);
