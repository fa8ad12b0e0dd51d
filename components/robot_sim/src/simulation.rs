//! World, robot, board and sensors on one virtual clock.
//!
//! The clock moves only in [`Simulation::advance`]; nothing here reads the time of day. So an algorithm can be tuned
//! in a closed loop at hundreds of times real speed, and the same commands at the same virtual times give the same
//! run, bit for bit.

use std::time::Duration;

use board_protocol::robot::NO_ANSWER;
use board_protocol::{Command, Encoders, Telemetry, Ultrasonic};
use serde::{Deserialize, Serialize};

use crate::board::Board;
use crate::camera::{self, Frame};
use crate::geometry::Pose;
use crate::motor::Drive;
use crate::noise::Noise;
use crate::robot::Robot;
use crate::scene::Scene;
use crate::sonar;
use crate::sonar_unit::{SonarFaults, SonarUnit};
use crate::world::World;

/// Step of the physics.
pub const TICK: Duration = Duration::from_millis(2);
/// The target is reached when its surface is this near to the robot's centre, in metres.
pub const REACHED_M: f64 = 0.5;
/// It is reached as well when the robot stands for [`STANDING`] and its surface is this near, in metres.
pub const REACHED_STANDING_M: f64 = 0.8;
/// How long the robot has to stand.
pub const STANDING: Duration = Duration::from_millis(500);
/// Wheels slower than this stand, in radians per second.
const STANDING_RAD_S: f64 = 0.05;

/// What is really the case, which no sensor tells.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Since the simulation began.
    pub time: Duration,
    /// Where the robot is.
    pub pose: Pose,
    /// Front-left, rear-left, front-right, rear-right, in radians per second.
    pub wheels_rad_s: [f64; 4],
    /// How often the robot has bumped into something.
    pub collisions: u32,
    /// From the robot's centre to the target's surface, in metres.
    pub target_m: f64,
    /// From the robot's centre to the nearest surface, in metres; the body's radius is 0.25 m.
    pub clearance_m: f64,
}

/// A world with the robot in it.
pub struct Simulation {
    world: World,
    scene: Scene,
    robot: Robot,
    board: Board,
    now_us: u64,
    /// Time advanced that does not fill a tick yet, in nanoseconds.
    rest_ns: u64,
    standing_since_us: u64,
    frames: u32,
    /// A sensor of the ring, and since when it is off.
    unplugged: Option<(usize, u64)>,
    sonar_noise: Noise,
    camera_noise: Noise,
    /// How long after the first command to drive the supply of the left wheels' drivers fails, in microseconds; `None`: never. The
    /// board does not notice.
    left_power_us: Option<u64>,
    /// When the first command to drive came.
    driven_us: Option<u64>,
    seed: u64,
    /// Further rings, and what they said that was not fetched yet.
    sonars: Vec<SonarUnit>,
    rounds: Vec<(usize, Telemetry)>,
}

impl Simulation {
    /// The robot at its start, the clock at zero.
    #[must_use]
    pub fn new(world: World, seed: u64) -> Self {
        Self {
            scene: Scene::new(&world),
            robot: Robot::new(world.start.pose()),
            world,
            board: Board::default(),
            now_us: 0,
            rest_ns: 0,
            standing_since_us: 0,
            frames: 0,
            unplugged: None,
            sonar_noise: Noise::new(seed, 1),
            camera_noise: Noise::new(seed, 2),
            left_power_us: None,
            driven_us: None,
            seed,
            sonars: Vec::new(),
            rounds: Vec::new(),
        }
    }

    /// Sensor `sensor` of the ultrasonic ring is pulled out at that time of the simulation: it does not answer any more.
    pub fn unplug(&mut self, sensor: usize, at: Duration) {
        self.unplugged = Some((sensor, u64::try_from(at.as_micros()).unwrap_or(u64::MAX)));
    }

    /// Lets the power of the left wheels' drivers fail that long after the first command to drive. Nobody is told: the board goes on
    /// as if they had it.
    pub fn cut_left_power_after(&mut self, time: Duration) {
        self.left_power_us = Some(u64::try_from(time.as_micros()).unwrap_or(u64::MAX / 2));
    }

    /// When the power of the left wheels failed; `None`: it has not.
    #[must_use]
    pub fn left_power_off(&self) -> Option<Duration> {
        let fails_us = self.driven_us? + self.left_power_us?;
        (self.now_us >= fails_us).then(|| Duration::from_micros(fails_us))
    }

    /// One more ultrasonic ring, redundant to the motion board's, whose rounds [`Self::sonar_rounds`] tells. They count from 0.
    pub fn add_sonar(&mut self, faults: SonarFaults) {
        let noise = Noise::new(self.seed, 3 + self.sonars.len() as u64);
        self.sonars.push(SonarUnit::new(faults, noise));
    }

    /// What further rings have sent since the last call, each with its number.
    pub fn sonar_rounds(&mut self) -> Vec<(usize, Telemetry)> {
        std::mem::take(&mut self.rounds)
    }

    /// The world as loaded.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Time since the simulation began.
    #[must_use]
    pub fn time(&self) -> Duration {
        Duration::from_micros(self.now_us)
    }

    /// Gives the board a command now.
    pub fn command(&mut self, command: Command) {
        if matches!(command, Command::WheelVelocities(speeds) if speeds.left_rad_s != 0.0 || speeds.right_rad_s != 0.0)
        {
            self.driven_us.get_or_insert(self.now_us);
        }
        self.board.command(command, self.now_us);
    }

    /// Lets time pass and returns the telemetry that the board sent meanwhile, in order.
    pub fn advance(&mut self, time: Duration) -> Vec<Telemetry> {
        let tick_ns = TICK.as_nanos() as u64;
        let total = self.rest_ns + u64::try_from(time.as_nanos()).unwrap_or(u64::MAX / 2);
        self.rest_ns = total % tick_ns;
        let mut sent = Vec::new();
        (0..total / tick_ns).for_each(|_| self.tick(&mut sent));
        sent
    }

    /// The newest picture, if one has fallen due since the last call.
    pub fn camera_frame(&mut self) -> Option<Frame> {
        let due = u32::try_from(self.now_us / camera::PERIOD.as_micros() as u64).unwrap_or(u32::MAX);
        (due >= self.frames).then(|| {
            self.frames = due + 1;
            self.picture(due)
        })
    }

    /// What is really the case.
    #[must_use]
    pub fn truth(&self) -> Truth {
        let pose = self.robot.pose();
        Truth {
            time: self.time(),
            pose,
            wheels_rad_s: self.robot.wheel_speeds(),
            collisions: self.robot.collisions(),
            target_m: self.world.target.distance(pose.at),
            clearance_m: self.scene.clearance(pose.at),
        }
    }

    /// Whether the robot is at its target: within [`REACHED_M`], or standing within [`REACHED_STANDING_M`].
    #[must_use]
    pub fn reached(&self) -> bool {
        let distance = self.world.target.distance(self.robot.pose().at);
        let stood = Duration::from_micros(self.now_us - self.standing_since_us) >= STANDING;
        distance <= REACHED_M || (stood && distance <= REACHED_STANDING_M)
    }

    fn picture(&mut self, seq: u32) -> Frame {
        Frame { seq, time_us: self.now_us, rgb: camera::render(&self.scene, self.robot.pose(), &mut self.camera_noise) }
    }

    fn tick(&mut self, sent: &mut Vec<Telemetry>) {
        let dt = TICK.as_secs_f64();
        let mut drives = self.board.drives(self.now_us, dt);
        if self.left_power_off().is_some() {
            drives.left = Drive::Neutral;
        }
        self.robot.step(drives, &self.scene, dt);
        self.now_us += TICK.as_micros() as u64;
        if self.robot.wheel_speeds().iter().any(|speed| speed.abs() > STANDING_RAD_S) {
            self.standing_since_us = self.now_us;
        }
        self.send(sent);
    }

    fn send(&mut self, sent: &mut Vec<Telemetry>) {
        let due = Board::due(self.now_us);
        // The board's clock has 32 bits and wraps.
        let time_us = self.now_us as u32;
        if due.encoders {
            sent.push(Telemetry::Encoders(Encoders { time_us, ticks: self.robot.ticks() }));
        }
        if due.ultrasonic {
            let mut ranges_mm = sonar::ring(&self.scene, self.robot.pose(), &mut self.sonar_noise);
            let unplugged = self.unplugged.filter(|(_, since_us)| self.now_us >= *since_us);
            if let Some(range) = unplugged.and_then(|(sensor, _)| ranges_mm.get_mut(sensor)) {
                *range = NO_ANSWER;
            }
            sent.push(Telemetry::Ultrasonic(Ultrasonic { time_us, ranges_mm }));
        }
        if due.ultrasonic {
            self.send_sonars(time_us);
        }
        if due.status {
            sent.push(Telemetry::Status(self.board.status(&self.robot, self.now_us)));
        }
    }

    fn send_sonars(&mut self, time_us: u32) {
        let driven = self.driven_us.map(|driven_us| Duration::from_micros(self.now_us - driven_us));
        for (number, sonar) in self.sonars.iter_mut().enumerate() {
            let round = sonar.round(&self.scene, self.robot.pose(), time_us, driven);
            self.rounds.extend(round.map(|round| (number, Telemetry::Ultrasonic(round))));
        }
    }
}
