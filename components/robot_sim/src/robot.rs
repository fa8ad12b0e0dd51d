//! The body: four wheels, skid steering, collisions.
//!
//! Decision: kinematics from the mean wheel speed of each side. A friction model per wheel contact was considered; it
//! adds parameters that nobody can measure on the paper's robot. What it would show and odometry must live with, that
//! the robot turns less than its wheels say, is one factor here.

use std::f64::consts::TAU;

use board_protocol::robot::{BODY_RADIUS_M, TICKS_PER_REVOLUTION, TRACK_WIDTH_M, WHEEL_RADIUS_M};

use crate::geometry::{Pose, wrap};
use crate::motor::{Drive, Motor};
use crate::scene::Scene;

/// Wheels slip sideways when the robot turns: it behaves as if its track were wider by this factor.
pub const TURNING_SLIP: f64 = 1.03;
/// A contact ends when the body is this far off again, in metres; less would count one scrape many times.
const CONTACT_ENDS_M: f64 = 0.01;

/// What both drivers do, left and right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drives {
    /// The two left motors.
    pub left: Drive,
    /// The two right motors.
    pub right: Drive,
}

/// The robot in its world.
#[derive(Debug, Clone)]
pub struct Robot {
    pose: Pose,
    /// Front-left, rear-left, front-right, rear-right.
    wheels: [Motor; 4],
    collisions: u32,
    touching: bool,
}

impl Robot {
    /// Standing at `pose`.
    #[must_use]
    pub fn new(pose: Pose) -> Self {
        Self { pose, wheels: [Motor::default(); 4], collisions: 0, touching: false }
    }

    /// Where it is.
    #[must_use]
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// Wheel speeds in radians per second: front-left, rear-left, front-right, rear-right.
    #[must_use]
    pub fn wheel_speeds(&self) -> [f64; 4] {
        self.wheels.map(|wheel| wheel.speed())
    }

    /// Encoder ticks since the start, wheels as above.
    #[must_use]
    pub fn ticks(&self) -> [i32; 4] {
        // Through i64 so that a long run wraps as the protocol says instead of sticking at the limit.
        self.wheels.map(|wheel| (wheel.angle() / TAU * f64::from(TICKS_PER_REVOLUTION)).floor() as i64 as i32)
    }

    /// Current that all motors draw, in amperes.
    #[must_use]
    pub fn supply_current(&self) -> f64 {
        self.wheels.iter().map(Motor::supply_current).sum()
    }

    /// How often the body has begun to touch something.
    #[must_use]
    pub fn collisions(&self) -> u32 {
        self.collisions
    }

    /// Whether the body touches something now.
    #[must_use]
    pub fn touching(&self) -> bool {
        self.touching
    }

    /// Goes on by `dt` seconds.
    pub fn step(&mut self, drives: Drives, scene: &Scene, dt: f64) {
        let [front_left, rear_left, front_right, rear_right] = &mut self.wheels;
        for (wheel, drive) in [
            (front_left, drives.left),
            (rear_left, drives.left),
            (front_right, drives.right),
            (rear_right, drives.right),
        ] {
            wheel.step(drive, dt);
        }
        self.roll(dt);
        self.collide(scene);
    }

    fn roll(&mut self, dt: f64) {
        let [front_left, rear_left, front_right, rear_right] = self.wheel_speeds();
        let left = (front_left + rear_left) / 2.0 * f64::from(WHEEL_RADIUS_M);
        let right = (front_right + rear_right) / 2.0 * f64::from(WHEEL_RADIUS_M);
        let turn = (right - left) / (f64::from(TRACK_WIDTH_M) * TURNING_SLIP) * dt;
        // The direction half-way through the step: exact for arcs up to third order.
        self.pose.at = self.pose.at.towards(self.pose.theta + turn / 2.0, (left + right) / 2.0 * dt);
        self.pose.theta = wrap(self.pose.theta + turn);
    }

    fn collide(&mut self, scene: &Scene) {
        let radius = f64::from(BODY_RADIUS_M);
        let (place, touched) = scene.push_out(self.pose.at, radius);
        self.pose.at = place;
        if touched && !self.touching {
            self.collisions += 1;
            self.touching = true;
        } else if self.touching && !touched && scene.clearance(place) > radius + CONTACT_ENDS_M {
            self.touching = false;
        }
    }
}
