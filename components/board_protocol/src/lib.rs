//! The framed protocol between the motion-board driver and the board, real or simulated.
//!
//! ```text
//! 0xA5 0x5A | payload length u8 | sequence u8 | kind u8 | payload 0..=64 | CRC-16/CCITT, low byte first
//! ```
//!
//! The check sum covers everything between the sync bytes and itself; numbers are little-endian.
//! Both directions use the same frame; [`Command`] goes from host to board, [`Telemetry`] back.
//!
//! Decision: fixed binary frames, no allocation, no dependency, `no_std`, so that the same crate builds into a
//! board's firmware. Lines of text were the alternative and lose: a cut line still parses as a shorter number, and
//! the ultrasonic ring alone would fill a tenth of 115200 baud.
//!
//! ```
//! use board_protocol::{Command, Decoder, Encoder, WheelVelocities};
//!
//! let mut host = Encoder::new();
//! let frame = host.encode(&Command::WheelVelocities(WheelVelocities { left_rad_s: 4.0, right_rad_s: 4.5 }));
//!
//! let mut board = Decoder::<Command>::new();
//! board.feed(&frame, |command| println!("{command:?}"));
//! assert_eq!(board.counters().frames, 1);
//! ```
#![no_std]

mod command;
mod crc;
mod decoder;
mod encoder;
mod payload;
pub mod robot;
mod telemetry;

pub use command::{Command, DriverPower, WheelVelocities};
pub use crc::crc16;
pub use decoder::{Counters, Decoder};
pub use encoder::{Encoder, Frame};
pub use payload::{Fields, Message, PayloadWriter};
pub use telemetry::{Encoders, Status, StatusFlags, Telemetry, Ultrasonic};

/// The two bytes every frame begins with.
pub const SYNC: [u8; 2] = [0xA5, 0x5A];
/// Bytes before the payload: sync, length, sequence number, kind.
pub const HEADER_BYTES: usize = 5;
/// Bytes after the payload: the check sum.
pub const TRAILER_BYTES: usize = 2;
/// The longest payload a frame may carry, in bytes.
pub const MAX_PAYLOAD_BYTES: usize = 64;
/// The longest frame, in bytes.
pub const MAX_FRAME_BYTES: usize = HEADER_BYTES + MAX_PAYLOAD_BYTES + TRAILER_BYTES;
