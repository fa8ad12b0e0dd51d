//! Frames from a stream of bytes: a header of 24 bytes, then the pixels.
//!
//! ```text
//! "FRAM" | width u32 | height u32 | sequence u32 | time_us u64 | width * height * 3 bytes RGB      (little-endian)
//! ```
//!
//! Decision: a small reader that takes what there is and never waits, so that a slow camera costs the executor nothing. Not chosen:
//! a reader thread with a queue; a plugin that starts threads is harder to contain and to stop.

use std::io::{self, ErrorKind, Read};

/// Bytes of the header.
const HEADER: usize = 24;

/// Longest side of an image, in pixels: a header that says more is taken for noise.
pub const MAX_SIDE: u32 = 4096;

/// A whole image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame<'a> {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Number given by the camera, counting up.
    pub sequence: u32,
    /// The camera's clock in us.
    pub time_us: u64,
    /// Three bytes a pixel, rows from the top.
    pub pixels: &'a [u8],
}

/// Collects bytes until a frame is whole.
#[derive(Clone, Debug, Default)]
pub struct FrameReader {
    bytes: Vec<u8>,
    filled: usize,
}

impl FrameReader {
    /// Reads from `source` until a frame is whole (gives it) or there is nothing more for now (gives `None`).
    ///
    /// # Errors
    /// The stream ended, failed, or holds something else than frames. Start anew with a new stream and [`FrameReader::restart`].
    pub fn read<'a>(&'a mut self, source: &mut impl Read) -> io::Result<Option<Frame<'a>>> {
        while self.filled < self.wanted()? {
            let wanted = self.wanted()?;
            // It only grows: clearing what the next read overwrites anyway costs more than the read.
            self.bytes.resize(wanted.max(self.bytes.len()), 0);
            match source.read(&mut self.bytes[self.filled..wanted]) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.filled += count,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(None),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        self.filled = 0;
        Ok(Some(self.frame()))
    }

    /// Forgets a half-read frame. Its memory is kept.
    pub fn restart(&mut self) {
        self.filled = 0;
    }

    /// How many bytes the frame being read has, as far as is known.
    fn wanted(&self) -> io::Result<usize> {
        if self.filled < HEADER {
            return Ok(HEADER);
        }
        let (width, height) = (self.u32_at(4), self.u32_at(8));
        let sides = 1..=MAX_SIDE;
        if !self.bytes.starts_with(b"FRAM") || !sides.contains(&width) || !sides.contains(&height) {
            return Err(io::Error::new(
                ErrorKind::InvalidData,
                "no frame header where one must be; is this the camera's socket?",
            ));
        }
        Ok(HEADER + width as usize * height as usize * 3)
    }

    fn frame(&self) -> Frame<'_> {
        let (width, height) = (self.u32_at(4), self.u32_at(8));
        let time_us = u64::from(self.u32_at(16)) | u64::from(self.u32_at(20)) << 32;
        let pixels = &self.bytes[HEADER..HEADER + width as usize * height as usize * 3];
        Frame { width, height, sequence: self.u32_at(12), time_us, pixels }
    }

    fn u32_at(&self, at: usize) -> u32 {
        let mut word = [0; 4];
        word.copy_from_slice(&self.bytes[at..at + 4]);
        u32::from_le_bytes(word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives its bytes in small pieces, with a pause after each.
    struct Trickle {
        bytes: Vec<u8>,
        piece: usize,
        pause: bool,
    }

    impl Read for Trickle {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.pause = !self.pause;
            if self.pause {
                return Err(ErrorKind::WouldBlock.into());
            }
            let count = self.piece.min(buffer.len()).min(self.bytes.len());
            buffer[..count].copy_from_slice(&self.bytes[..count]);
            self.bytes.drain(..count);
            Ok(count)
        }
    }

    fn encode(width: u32, height: u32, sequence: u32) -> Vec<u8> {
        let mut bytes = b"FRAM".to_vec();
        [width, height, sequence].iter().for_each(|word| bytes.extend(word.to_le_bytes()));
        bytes.extend((u64::from(sequence) << 33).to_le_bytes());
        bytes.extend((0..width * height * 3).map(|n| (n + sequence) as u8));
        bytes
    }

    #[test]
    fn frames_come_whole_however_the_bytes_come() {
        for piece in [1, 7, 24, 1000] {
            let bytes = [encode(4, 3, 1), encode(2, 2, 2)].concat();
            let mut source = Trickle { bytes, piece, pause: false };
            let (mut reader, mut seen) = (FrameReader::default(), Vec::new());
            for _ in 0..1000 {
                match reader.read(&mut source) {
                    Ok(Some(frame)) => seen.push((frame.width, frame.sequence, frame.time_us, frame.pixels.len())),
                    Ok(None) => {}
                    Err(_) => break,
                }
            }
            assert_eq!(seen, [(4, 1, 1 << 33, 36), (2, 2, 2 << 33, 12)]);
        }
    }

    #[test]
    fn something_else_is_refused_before_memory_is_asked_for() {
        let mut reader = FrameReader::default();
        let mut header = encode(1, 1, 0);
        header[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        let refused = reader.read(&mut header.as_slice());
        assert!(refused.is_err_and(|error| error.kind() == ErrorKind::InvalidData));
        reader.restart();
        assert!(reader.read(&mut &b"HTTP/1.1 200 OK and so on and so on"[..]).is_err());
    }
}
