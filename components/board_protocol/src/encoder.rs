//! Message to frame.

use core::ops::Deref;

use crate::payload::{Message, PayloadWriter};
use crate::{HEADER_BYTES, MAX_FRAME_BYTES, SYNC, crc16};

/// One frame, ready to be written to the line. Dereferences to its bytes.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    bytes: [u8; MAX_FRAME_BYTES],
    length: usize,
}

impl Deref for Frame {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

/// Numbers the frames of one direction of one line.
#[derive(Debug, Clone, Default)]
pub struct Encoder {
    sequence: u8,
}

impl Encoder {
    /// Begins with sequence number 0.
    #[must_use]
    pub const fn new() -> Self {
        Self { sequence: 0 }
    }

    /// The frame that carries `message`, with the next sequence number.
    pub fn encode<M: Message>(&mut self, message: &M) -> Frame {
        let mut payload = PayloadWriter::new();
        message.write(&mut payload);
        let frame = frame(self.sequence, message.kind(), payload.bytes());
        self.sequence = self.sequence.wrapping_add(1);
        frame
    }
}

fn frame(sequence: u8, kind: u8, payload: &[u8]) -> Frame {
    let mut bytes = [0; MAX_FRAME_BYTES];
    let end = HEADER_BYTES + payload.len();
    bytes[..2].copy_from_slice(&SYNC);
    // The writer holds at most MAX_PAYLOAD_BYTES = 64, which fits a byte.
    bytes[2..HEADER_BYTES].copy_from_slice(&[payload.len() as u8, sequence, kind]);
    bytes[HEADER_BYTES..end].copy_from_slice(payload);
    let crc = crc16(&bytes[SYNC.len()..end]);
    bytes[end..end + 2].copy_from_slice(&crc.to_le_bytes());
    Frame { bytes, length: end + 2 }
}
