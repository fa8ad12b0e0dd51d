//! Host to board: set points, emergency stop, driver power.

use crate::payload::{Fields, Message, PayloadWriter};

/// Angular velocity set points of the wheels, per side. Held by the board until the next one or its watchdog.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelVelocities {
    /// Left wheels, radians per second; positive drives forward.
    pub left_rad_s: f32,
    /// Right wheels, radians per second; positive drives forward.
    pub right_rad_s: f32,
}

/// Switches the motor drivers' power, per side. Both sides are on after the board starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DriverPower {
    /// Power of both left motors.
    pub left: bool,
    /// Power of both right motors.
    pub right: bool,
}

/// What the host may ask of the board. Every command feeds the board's watchdog.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Drive the wheels at these speeds. Ignored while the emergency stop is latched.
    WheelVelocities(WheelVelocities),
    /// Motors to neutral at once; latched until [`Command::Release`].
    EmergencyStop,
    /// Ends the emergency stop. The set points are zero until the next [`Command::WheelVelocities`].
    Release,
    /// Switches driver power on or off.
    DriverPower(DriverPower),
}

const WHEEL_VELOCITIES: u8 = 0x01;
const EMERGENCY_STOP: u8 = 0x02;
const RELEASE: u8 = 0x03;
const DRIVER_POWER: u8 = 0x04;
const LEFT: u8 = 1;
const RIGHT: u8 = 2;

impl Message for Command {
    fn kind(&self) -> u8 {
        match self {
            Self::WheelVelocities(_) => WHEEL_VELOCITIES,
            Self::EmergencyStop => EMERGENCY_STOP,
            Self::Release => RELEASE,
            Self::DriverPower(_) => DRIVER_POWER,
        }
    }

    fn write(&self, payload: &mut PayloadWriter) {
        match self {
            Self::WheelVelocities(speeds) => {
                payload.put(&speeds.left_rad_s.to_le_bytes());
                payload.put(&speeds.right_rad_s.to_le_bytes());
            }
            Self::DriverPower(power) => {
                payload.put(&[(u8::from(power.left) * LEFT) | (u8::from(power.right) * RIGHT)]);
            }
            Self::EmergencyStop | Self::Release => {}
        }
    }

    fn read(kind: u8, payload: &[u8]) -> Option<Self> {
        let mut fields = Fields::of(payload);
        let command = match kind {
            WHEEL_VELOCITIES => {
                Self::WheelVelocities(WheelVelocities { left_rad_s: fields.f32()?, right_rad_s: fields.f32()? })
            }
            EMERGENCY_STOP => Self::EmergencyStop,
            RELEASE => Self::Release,
            DRIVER_POWER => {
                let sides = fields.u8()?;
                Self::DriverPower(DriverPower { left: sides & LEFT != 0, right: sides & RIGHT != 0 })
            }
            _ => return None,
        };
        fields.end(command)
    }
}
