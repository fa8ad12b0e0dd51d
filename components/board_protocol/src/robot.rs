//! What driver and board both know about the robot: geometry, encoders, ring, line speed, watchdog.
//!
//! Decision: constants here, not properties of components. Driver, odometry and simulator must agree on them, and a
//! profile that says one radius to the driver and another to the odometry would be wrong without a diagnostic.

use core::f32::consts::PI;

/// Radius of each wheel, in metres.
pub const WHEEL_RADIUS_M: f32 = 0.0625;
/// Distance between the left and the right wheels' contact lines, in metres.
pub const TRACK_WIDTH_M: f32 = 0.40;
/// Radius of the circle that holds the robot's body, in metres.
pub const BODY_RADIUS_M: f32 = 0.25;
/// Encoder ticks of one wheel revolution.
pub const TICKS_PER_REVOLUTION: i32 = 2000;
/// Way of the wheel's rim per encoder tick, in metres.
pub const METRES_PER_TICK: f32 = 2.0 * PI * WHEEL_RADIUS_M / TICKS_PER_REVOLUTION as f32;
/// Fastest wheel speed the board accepts; faster set points are limited to it. In radians per second (1 m/s).
pub const MAX_WHEEL_RAD_S: f32 = 16.0;

/// Number of ultrasonic sensors in the ring.
pub const RING: usize = 12;
/// Angle from one ultrasonic sensor to the next, counter-clockwise, in radians (30 degrees).
pub const RING_STEP_RAD: f32 = 2.0 * PI / RING as f32;
/// Distance of each ultrasonic sensor from the robot's centre, in metres; ranges count from the sensor.
pub const RING_RADIUS_M: f32 = 0.20;
/// Shortest range an ultrasonic sensor reports, in millimetres.
pub const MIN_RANGE_MM: u16 = 30;
/// Longest range an ultrasonic sensor reports, in millimetres; also what it reports when no echo has come back in time.
pub const MAX_RANGE_MM: u16 = 3000;
/// What [`crate::Ultrasonic`] holds for a sensor that does not answer: it is unplugged, or broken.
pub const NO_ANSWER: u16 = 0;

/// Speed of the serial line, in baud (8 data bits, no parity, one stop bit).
pub const BAUD: u32 = 115_200;
/// The board stops its motors when no command has come for this long, in milliseconds.
pub const WATCHDOG_MS: u32 = 200;
/// Encoder telemetry period, in milliseconds (50 Hz).
pub const ENCODER_PERIOD_MS: u32 = 20;
/// Ultrasonic telemetry period, in milliseconds (20 Hz).
pub const ULTRASONIC_PERIOD_MS: u32 = 50;
/// Status telemetry period, in milliseconds (10 Hz).
pub const STATUS_PERIOD_MS: u32 = 100;
/// Supply voltage of a full battery, in millivolts.
pub const SUPPLY_MV: u16 = 12_000;
