//! Board to host: encoders, ultrasonic ring, status.

use crate::payload::{Fields, Message, PayloadWriter};
use crate::robot::RING;

/// Wheel encoders, at 50 Hz or more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encoders {
    /// The board's clock since it started, in microseconds; wraps after 71 minutes.
    pub time_us: u32,
    /// Ticks since the board started: front-left, rear-left, front-right, rear-right. They wrap.
    pub ticks: [i32; 4],
}

/// The ring of ultrasonic range finders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ultrasonic {
    /// The board's clock since it started, in microseconds; wraps after 71 minutes.
    pub time_us: u32,
    /// Range of each sensor in millimetres, from the sensor's face. Index 0 looks straight ahead, the others follow
    /// counter-clockwise every 30 degrees. Within 30 to 3000; 3000 is also what a sensor without echo says, as one does
    /// whose time is over; 0 only one that does not answer at all.
    pub ranges_mm: [u16; RING],
}

/// How the board is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status {
    /// What is on, latched or stopped.
    pub flags: StatusFlags,
    /// Supply voltage in millivolts.
    pub supply_mv: u16,
}

/// Set of the board's conditions, one bit each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StatusFlags(pub u8);

impl StatusFlags {
    /// The emergency stop is latched.
    pub const EMERGENCY: Self = Self(1);
    /// The watchdog has stopped the motors because commands ceased.
    pub const WATCHDOG: Self = Self(2);
    /// The left drivers have power.
    pub const LEFT_POWER: Self = Self(4);
    /// The right drivers have power.
    pub const RIGHT_POWER: Self = Self(8);
    /// The bumper touches something.
    pub const BUMPER: Self = Self(16);

    /// Whether every flag of `other` is set here.
    #[must_use]
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// These flags, and `other`'s if `set`.
    #[must_use]
    pub const fn with(self, other: Self, set: bool) -> Self {
        if set { Self(self.0 | other.0) } else { self }
    }
}

/// What the board tells the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Telemetry {
    /// Wheel encoders.
    Encoders(Encoders),
    /// Ultrasonic ring.
    Ultrasonic(Ultrasonic),
    /// Board status.
    Status(Status),
}

const ENCODERS: u8 = 0x81;
const ULTRASONIC: u8 = 0x82;
const STATUS: u8 = 0x83;

impl Message for Telemetry {
    fn kind(&self) -> u8 {
        match self {
            Self::Encoders(_) => ENCODERS,
            Self::Ultrasonic(_) => ULTRASONIC,
            Self::Status(_) => STATUS,
        }
    }

    fn write(&self, payload: &mut PayloadWriter) {
        match self {
            Self::Encoders(encoders) => {
                payload.put(&encoders.time_us.to_le_bytes());
                encoders.ticks.iter().for_each(|ticks| payload.put(&ticks.to_le_bytes()));
            }
            Self::Ultrasonic(ring) => {
                payload.put(&ring.time_us.to_le_bytes());
                ring.ranges_mm.iter().for_each(|range| payload.put(&range.to_le_bytes()));
            }
            Self::Status(status) => {
                payload.put(&[status.flags.0]);
                payload.put(&status.supply_mv.to_le_bytes());
            }
        }
    }

    fn read(kind: u8, payload: &[u8]) -> Option<Self> {
        let mut fields = Fields::of(payload);
        let telemetry = match kind {
            ENCODERS => Self::Encoders(Encoders { time_us: fields.u32()?, ticks: ticks(&mut fields)? }),
            ULTRASONIC => Self::Ultrasonic(Ultrasonic { time_us: fields.u32()?, ranges_mm: ranges(&mut fields)? }),
            STATUS => Self::Status(Status { flags: StatusFlags(fields.u8()?), supply_mv: fields.u16()? }),
            _ => return None,
        };
        fields.end(telemetry)
    }
}

fn ticks(fields: &mut Fields<'_>) -> Option<[i32; 4]> {
    Some([fields.i32()?, fields.i32()?, fields.i32()?, fields.i32()?])
}

fn ranges(fields: &mut Fields<'_>) -> Option<[u16; RING]> {
    let mut ranges = [0; RING];
    for range in &mut ranges {
        *range = fields.u16()?;
    }
    Some(ranges)
}
