//! The board's own logic: set points, ramp, watchdog, latched emergency stop, driver power, telemetry times.
//!
//! It keeps the robot safe when the host fails: without commands for [`WATCHDOG_MS`] it drives the wheels to zero.

use board_protocol::robot::{
    ENCODER_PERIOD_MS, MAX_WHEEL_RAD_S, STATUS_PERIOD_MS, SUPPLY_MV, ULTRASONIC_PERIOD_MS, WATCHDOG_MS,
};
use board_protocol::{Command, DriverPower, Status, StatusFlags, WheelVelocities};

use crate::motor::Drive;
use crate::robot::{Drives, Robot};

/// Fastest change of a wheel's set point, in radians per second squared (2.5 m/s² at the rim): beyond it tyres slip.
const RAMP_RAD_S2: f64 = 40.0;
/// Inner resistance of the supply, in millivolts per ampere.
const SAG_MV_PER_A: f64 = 60.0;
/// The supply loses this much per second of driving, in millivolts.
const DRAIN_MV_PER_S: f64 = 0.4;

/// What to send at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Due {
    /// Encoder telemetry.
    pub encoders: bool,
    /// Ultrasonic telemetry.
    pub ultrasonic: bool,
    /// Status telemetry.
    pub status: bool,
}

/// The motion board.
#[derive(Debug, Clone)]
pub struct Board {
    wanted: WheelVelocities,
    /// Set points after the ramp, radians per second, left and right.
    ramped: [f64; 2],
    power: DriverPower,
    emergency: bool,
    last_command_us: Option<u64>,
}

const STANDING: WheelVelocities = WheelVelocities { left_rad_s: 0.0, right_rad_s: 0.0 };

impl Default for Board {
    fn default() -> Self {
        let power = DriverPower { left: true, right: true };
        Self { wanted: STANDING, ramped: [0.0; 2], power, emergency: false, last_command_us: None }
    }
}

impl Board {
    /// Takes a command that came at `now_us` (microseconds since the board started).
    pub fn command(&mut self, command: Command, now_us: u64) {
        self.last_command_us = Some(now_us);
        match command {
            Command::WheelVelocities(speeds) if !self.emergency => self.wanted = limited(speeds),
            Command::WheelVelocities(_) => {}
            Command::EmergencyStop => {
                self.emergency = true;
                self.wanted = STANDING;
            }
            Command::Release => self.emergency = false,
            Command::DriverPower(power) => self.power = power,
        }
    }

    /// What the drivers do for the next `dt` seconds.
    pub fn drives(&mut self, now_us: u64, dt: f64) -> Drives {
        if self.watchdog(now_us) {
            self.wanted = STANDING;
        }
        let wanted = [f64::from(self.wanted.left_rad_s), f64::from(self.wanted.right_rad_s)];
        for (ramped, wanted) in self.ramped.iter_mut().zip(wanted) {
            let step = RAMP_RAD_S2 * dt;
            *ramped = if self.emergency { 0.0 } else { *ramped + (wanted - *ramped).clamp(-step, step) };
        }
        let drive = |side: usize, power| {
            if power && !self.emergency { Drive::Speed(self.ramped[side]) } else { Drive::Neutral }
        };
        Drives { left: drive(0, self.power.left), right: drive(1, self.power.right) }
    }

    /// Whether commands have ceased.
    #[must_use]
    pub fn watchdog(&self, now_us: u64) -> bool {
        self.last_command_us.is_none_or(|last| now_us - last > u64::from(WATCHDOG_MS) * 1000)
    }

    /// The status at `now_us`.
    #[must_use]
    pub fn status(&self, robot: &Robot, now_us: u64) -> Status {
        let flags = StatusFlags::default()
            .with(StatusFlags::EMERGENCY, self.emergency)
            .with(StatusFlags::WATCHDOG, self.watchdog(now_us))
            .with(StatusFlags::LEFT_POWER, self.power.left)
            .with(StatusFlags::RIGHT_POWER, self.power.right)
            .with(StatusFlags::BUMPER, robot.touching());
        let lost = SAG_MV_PER_A * robot.supply_current() + DRAIN_MV_PER_S * now_us as f64 / 1e6;
        Status { flags, supply_mv: (f64::from(SUPPLY_MV) - lost) as u16 }
    }

    /// Which telemetry falls due at `now_us`, a multiple of the tick.
    #[must_use]
    pub fn due(now_us: u64) -> Due {
        let every = |period_ms: u32| now_us.is_multiple_of(u64::from(period_ms) * 1000);
        Due {
            encoders: every(ENCODER_PERIOD_MS),
            ultrasonic: every(ULTRASONIC_PERIOD_MS),
            status: every(STATUS_PERIOD_MS),
        }
    }
}

fn limited(speeds: WheelVelocities) -> WheelVelocities {
    let limit = |speed: f32| speed.clamp(-MAX_WHEEL_RAD_S, MAX_WHEEL_RAD_S);
    WheelVelocities { left_rad_s: limit(speeds.left_rad_s), right_rad_s: limit(speeds.right_rad_s) }
}
