//! The simulated robot, as a library: stepped in-process on a virtual clock.
//!
//! world file → [`World`] → [`scene`] → [`motor`]s and [`robot`] → [`board`] → [`sonar`], [`camera`] → [`Simulation`]
//!
//! The `robot-sim` program plays the same [`Simulation`] in real time on a pseudo-terminal ([`serve`]); `robot-demo` runs it
//! against the daemon. To tune an algorithm none of that is needed:
//!
//! ```
//! use std::time::Duration;
//! use board_protocol::{Command, Telemetry, WheelVelocities};
//! use robot_sim::{Simulation, World};
//!
//! let mut robot = Simulation::new(World::warehouse(), 1);
//! while robot.time() < Duration::from_secs(2) {
//!     robot.command(Command::WheelVelocities(WheelVelocities { left_rad_s: 4.0, right_rad_s: 4.0 }));
//!     for telemetry in robot.advance(Duration::from_millis(20)) {
//!         if let Telemetry::Ultrasonic(ring) = telemetry { assert!(ring.ranges_mm[0] <= 3000) }
//!     }
//!     if let Some(picture) = robot.camera_frame() { assert_eq!(picture.rgb.len(), 160 * 120 * 3) }
//! }
//! assert!(robot.truth().pose.at.x > 1.2);
//! ```

pub mod board;
pub mod camera;
pub mod demo;
pub mod geometry;
pub mod motor;
pub mod noise;
pub mod robot;
pub mod scene;
pub mod serve;
pub mod simulation;
pub mod sonar;
pub mod sonar_unit;
pub mod world;

pub use simulation::{Simulation, Truth};
pub use sonar_unit::SonarFaults;
pub use world::World;
