//! The serial line to the board: commands out, telemetry in, never waiting.
//!
//! Decision: one struct over anything that reads and writes without blocking, so that tests use a buffer and the robot a serial port.
//! Not chosen: a reader thread; the line brings a hundred small frames a second, which one look every 10 ms takes in passing.

use std::io::{self, ErrorKind, Read, Write};

use board_protocol::{Command, Decoder, Encoder, Frame, Telemetry, WheelVelocities};

/// Most bytes taken in one look: four times what the line can bring in 10 ms at 115200 baud.
const BYTES_PER_LOOK: usize = 512;

/// A line to the board that is open.
pub struct Link<L> {
    line: L,
    encoder: Encoder,
    decoder: Decoder<Telemetry>,
    cut: u32,
}

impl<L: Read + Write> Link<L> {
    /// Speaks over `line`, whose reads and writes must return at once (`WouldBlock` or `TimedOut` when there is nothing to do).
    pub fn new(line: L) -> Self {
        Self { line, encoder: Encoder::new(), decoder: Decoder::new(), cut: 0 }
    }

    /// The line itself.
    pub const fn line(&self) -> &L {
        &self.line
    }

    /// Hands all telemetry that has come to `sink`.
    ///
    /// # Errors
    /// The line is lost.
    pub fn listen(&mut self, mut sink: impl FnMut(Telemetry)) -> io::Result<()> {
        let mut bytes = [0; BYTES_PER_LOOK];
        match self.line.read(&mut bytes) {
            Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "the other end hung up")),
            Ok(count) => {
                self.decoder.feed(&bytes[..count], &mut sink);
                Ok(())
            }
            Err(error) => nothing_now(error),
        }
    }

    /// Tells the board how fast the wheels are to turn, in rad/s.
    ///
    /// # Errors
    /// The line is lost. A full line is no error: the next command comes soon, and the board stops by itself without.
    pub fn drive(&mut self, left: f64, right: f64) -> io::Result<()> {
        let frame = command(&mut self.encoder, left, right);
        match self.line.write(&frame) {
            // A frame cut short fails its check sum at the board, like any other noise; the next one comes soon.
            Ok(count) => {
                self.cut = self.cut.wrapping_add(u32::from(count < frame.len()));
                Ok(())
            }
            Err(error) => nothing_now(error),
        }
    }

    /// Frames damaged on the way, in either direction as far as is known here, since the line was opened.
    #[must_use]
    pub fn damaged(&self) -> u32 {
        let seen = self.decoder.counters();
        seen.checksum_errors.wrapping_add(seen.rejected).wrapping_add(self.cut)
    }
}

/// The command that stops the wheels, ready to send. Not the emergency stop: that stays latched, and whoever starts the
/// daemon again could not drive on.
#[must_use]
pub fn neutral() -> Frame {
    command(&mut Encoder::new(), 0.0, 0.0)
}

fn command(encoder: &mut Encoder, left: f64, right: f64) -> Frame {
    encoder.encode(&Command::WheelVelocities(WheelVelocities { left_rad_s: left as f32, right_rad_s: right as f32 }))
}

fn nothing_now(error: io::Error) -> io::Result<()> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Ok(()),
        _ => Err(error),
    }
}

/// The board's 32-bit microseconds, continued past their wrap-around.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardClock {
    now_us: u64,
}

impl BoardClock {
    /// The continued time in us of a reading. Readings may be a little out of order, but not by half an hour.
    pub fn at(&mut self, reading: u32) -> u64 {
        let ahead = i64::from(reading.wrapping_sub(self.now_us as u32) as i32);
        let time = self.now_us.saturating_add_signed(ahead);
        self.now_us = self.now_us.max(time);
        time
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use board_protocol::Encoders;
    use std::collections::VecDeque;

    #[derive(Default)]
    struct Wire {
        to_host: VecDeque<u8>,
        to_board: Vec<u8>,
        cut: bool,
    }

    impl Read for &mut Wire {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            match self.to_host.read(buffer) {
                Ok(0) if self.cut => Err(ErrorKind::BrokenPipe.into()),
                Ok(0) => Err(ErrorKind::TimedOut.into()),
                other => other,
            }
        }
    }

    impl Write for &mut Wire {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.to_board.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn telemetry_comes_through_noise() {
        let telemetry = Telemetry::Encoders(Encoders { time_us: 7, ticks: [1, -2, 3, -4] });
        let frame = Encoder::new().encode(&telemetry);
        let mut wire = Wire { to_host: [&[0xA5, 0x00, 0x5A][..], &frame[..]].concat().into(), ..Wire::default() };
        let mut seen = Vec::new();
        let mut link = Link::new(&mut wire);
        assert!(link.listen(|message| seen.push(message)).is_ok());
        assert!(link.listen(|_| ()).is_ok(), "nothing new is no error");
        assert_eq!(seen, [telemetry]);
    }

    #[test]
    fn a_command_reaches_the_board() {
        let mut wire = Wire::default();
        assert!(Link::new(&mut wire).drive(1.5, -2.5).is_ok());
        let mut seen = Vec::new();
        Decoder::<Command>::new().feed(&wire.to_board, |command| seen.push(command));
        assert_eq!(seen, [Command::WheelVelocities(WheelVelocities { left_rad_s: 1.5, right_rad_s: -2.5 })]);
    }

    #[test]
    fn a_cut_line_is_an_error() {
        let mut wire = Wire { cut: true, ..Wire::default() };
        assert!(Link::new(&mut wire).listen(|_| ()).is_err());
    }

    #[test]
    fn the_clock_goes_on_past_32_bits() {
        let mut clock = BoardClock::default();
        assert_eq!(clock.at(5), 5);
        assert_eq!(clock.at(u32::MAX / 3), u64::from(u32::MAX / 3));
        assert_eq!(clock.at(u32::MAX / 3 * 2), u64::from(u32::MAX / 3 * 2));
        assert_eq!(clock.at(u32::MAX), u64::from(u32::MAX));
        assert_eq!(clock.at(9), u64::from(u32::MAX) + 10);
        assert_eq!(clock.at(u32::MAX), u64::from(u32::MAX), "a late reading stays in the past");
    }
}
