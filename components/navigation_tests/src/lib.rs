//! The navigation robot's algorithms in a closed loop with the simulator.
//!
//! Decision: the cores are called directly, at the periods that the profile gives their components, on the simulator's virtual
//! clock: a run of half a minute takes a fraction of a second, and the same seed gives the same run. The daemon's part (threads,
//! ports, recovery) has its own tests; here only the robot's behaviour is in question.

/// The experiment of the paper's figure 10 as a drawing.
pub mod figure10;
/// The power of the left wheels fails, and a model of them tells.
pub mod power_off;

use std::time::Duration;

use avoidance_primary::steering as primary;
use avoidance_secondary::steering as secondary;
use board_protocol::{Command, Telemetry, WheelVelocities};
use encoder_odometry::odometer::{Drive as OdometryDrive, Odometer};
use motor_control::wheel_control::{Drive, WheelControl};
use object_detector::blob::BlobFinder;
use object_detector::detector::{Picture, Settings as DetectorSettings, detect};
use path_planner::estimate::Pose;
use path_planner::planner::{Planner, Settings as PlannerSettings};
use robot_objects::motion::Motion;
use robot_objects::ring::Ranges;
use robot_sim::{Simulation, World, camera};
use ultrasonic::ring_filter::{RingFilter, Settings as RingSettings};

/// One step of the loop: the period of the fastest component.
const STEP: Duration = Duration::from_millis(10);

/// Which avoider steers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Avoider {
    /// Polar histogram.
    Primary,
    /// Potential field.
    Secondary,
}

/// What a run is like.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// The world.
    pub world: World,
    /// Seed of the sensors' noise.
    pub seed: u64,
    /// Who steers at a time (s).
    pub avoider: fn(f64) -> Avoider,
    /// Whether commands reach the board at a time (s).
    pub commands_pass: fn(f64) -> bool,
    /// Whether the odometry starts anew at a time (s), asked every 50 ms.
    pub odometry_restarts: fn(f64) -> bool,
    /// How careful the primary is.
    pub primary: primary::Settings,
    /// How careful the secondary is.
    pub secondary: secondary::Settings,
    /// What the planner is told.
    pub planner: PlannerSettings,
    /// Longest run in s.
    pub patience: f64,
}

impl Scenario {
    /// The default world with primary avoidance, as in `profiles/navigation`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            world: World::warehouse(),
            seed,
            avoider: |_| Avoider::Primary,
            commands_pass: |_| true,
            odometry_restarts: |_| false,
            primary: primary::Settings::default(),
            secondary: secondary::Settings::default(),
            planner: PlannerSettings { goal: Some((8.4, 0.0)), ..PlannerSettings::default() },
            patience: 90.0,
        }
    }
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The robot is at its target.
    pub reached: bool,
    /// Seconds it took.
    pub seconds: f64,
    /// How often it bumped into something.
    pub collisions: u32,
    /// Least distance of its body from anything but the target, in m.
    pub closest: f64,
    /// Path as (x, y) in m, four points a second.
    pub path: Vec<(f64, f64)>,
}

/// Runs a scenario to its end.
#[must_use]
pub fn run(scenario: &Scenario) -> Report {
    let mut robot = Robot::new(scenario);
    let mut report = Report { reached: false, seconds: 0.0, collisions: 0, closest: f64::INFINITY, path: Vec::new() };
    for step in 0_u32.. {
        robot.step(step, scenario);
        let truth = robot.simulation.truth();
        report.closest = report.closest.min(truth.clearance_m - 0.25);
        if step.is_multiple_of(25) {
            report.path.push((truth.pose.at.x, truth.pose.at.y));
        }
        report.reached = robot.simulation.reached();
        (report.seconds, report.collisions) = (truth.time.as_secs_f64(), truth.collisions);
        if report.reached || report.seconds > scenario.patience {
            break;
        }
    }
    report
}

/// All components of the robot.
struct Robot {
    simulation: Simulation,
    filter: RingFilter,
    odometer: Odometer,
    finder: BlobFinder,
    planner: Planner,
    primary: primary::Steering,
    secondary: secondary::Steering,
    wheels: WheelControl,
    steered_by: Avoider,
    ranges: Option<Ranges>,
    course: Motion,
    command: Motion,
}

impl Robot {
    fn new(scenario: &Scenario) -> Self {
        Self {
            simulation: Simulation::new(scenario.world.clone(), scenario.seed),
            filter: RingFilter::default(),
            odometer: Odometer::default(),
            finder: BlobFinder::default(),
            planner: Planner::default(),
            primary: primary::Steering::default(),
            secondary: secondary::Steering::default(),
            wheels: WheelControl::default(),
            steered_by: Avoider::Primary,
            ranges: None,
            course: Motion::STOP,
            command: Motion::STOP,
        }
    }

    fn step(&mut self, number: u32, scenario: &Scenario) {
        let now = self.simulation.time().as_secs_f64();
        self.listen();
        self.look(now);
        if number.is_multiple_of(5) {
            if (scenario.odometry_restarts)(now) {
                self.odometer = Odometer::default();
            }
            self.planner.follow(&self.pose(), now);
            self.course = self.planner.course(&self.pose(), now, &scenario.planner);
        }
        if number.is_multiple_of(2) {
            self.avoid((scenario.avoider)(now), scenario);
            let wheels = self.wheels.drive(self.command, 0.02, &Drive::default());
            if let Some([left, right]) = wheels.filter(|_| (scenario.commands_pass)(now)) {
                let speeds = WheelVelocities { left_rad_s: left as f32, right_rad_s: right as f32 };
                self.simulation.command(Command::WheelVelocities(speeds));
            }
        }
    }

    fn listen(&mut self) {
        for telemetry in self.simulation.advance(STEP) {
            match telemetry {
                Telemetry::Encoders(encoders) => {
                    let time = f64::from(encoders.time_us) / 1e6;
                    self.odometer.advance(encoders.ticks, time, &OdometryDrive::default());
                    self.wheels.observe(encoders.ticks, time, &Drive::default());
                }
                Telemetry::Ultrasonic(ring) => {
                    let raw = ring.ranges_mm.map(|range| f32::from(range) / 1000.0);
                    self.ranges = Some(self.filter.accept(&raw, &RingSettings::default()));
                }
                Telemetry::Status(_) => {}
            }
        }
    }

    fn look(&mut self, now: f64) {
        let Some(frame) = self.simulation.camera_frame() else { return };
        let (width, height) = (camera::WIDTH as u32, camera::HEIGHT as u32);
        let picture = Picture { width, height, step: width * 3, data: &frame.rgb };
        if let Some(seen) = detect(&mut self.finder, picture, &DetectorSettings::default()) {
            self.planner.sight(&self.pose(), seen.bearing, seen.distance, now);
        }
    }

    /// A replacement starts from scratch, as it does in the daemon.
    fn avoid(&mut self, avoider: Avoider, scenario: &Scenario) {
        if avoider != self.steered_by {
            self.steered_by = avoider;
            (self.primary, self.secondary) = Default::default();
        }
        let Some(ranges) = &self.ranges else { return };
        self.command = match avoider {
            Avoider::Primary => self.primary.steer(ranges, self.course, &scenario.primary),
            Avoider::Secondary => self.secondary.steer(ranges, self.course, &scenario.secondary),
        };
    }

    fn pose(&self) -> Pose {
        Pose { x: self.odometer.x, y: self.odometer.y, heading: self.odometer.heading }
    }
}
