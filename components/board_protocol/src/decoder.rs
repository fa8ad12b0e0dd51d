//! Bytes to messages: incremental, resynchronising, counting what went wrong.
//!
//! Decision: after a bad check sum only the *first* byte is given up and the rest is searched again. Throwing the
//! whole supposed frame away is shorter, but one false sync in noise then swallows up to 71 bytes of good frames
//! behind it.

use core::marker::PhantomData;

use crate::payload::Message;
use crate::{HEADER_BYTES, MAX_FRAME_BYTES, MAX_PAYLOAD_BYTES, SYNC, TRAILER_BYTES, crc16};

/// What a decoder has seen since it was made. All counters wrap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    /// Messages delivered.
    pub frames: u32,
    /// Frames that never came, by the gaps in the sequence numbers. A peer that starts anew counts as up to 255.
    pub lost: u32,
    /// Frames whose check sum was wrong.
    pub checksum_errors: u32,
    /// Frames with a good check sum but an unknown kind, a wrong length or a number that is not finite.
    pub rejected: u32,
    /// Bytes that belonged to no frame.
    pub skipped_bytes: u32,
}

/// Finds the frames of one direction in a stream of bytes.
#[derive(Debug, Clone)]
pub struct Decoder<M> {
    bytes: [u8; MAX_FRAME_BYTES],
    length: usize,
    expected: Option<u8>,
    counters: Counters,
    message: PhantomData<fn() -> M>,
}

/// What the bytes collected so far are.
enum Look {
    /// The beginning of a frame.
    Incomplete,
    /// No frame begins here.
    Noise,
    /// A whole frame, its check sum wrong.
    Corrupt,
    /// A whole frame of this many bytes.
    Frame(usize),
}

impl<M: Message> Default for Decoder<M> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: Message> Decoder<M> {
    /// A decoder that waits for its first frame.
    #[must_use]
    pub const fn new() -> Self {
        let counters = Counters { frames: 0, lost: 0, checksum_errors: 0, rejected: 0, skipped_bytes: 0 };
        Self { bytes: [0; MAX_FRAME_BYTES], length: 0, expected: None, counters, message: PhantomData }
    }

    /// Takes bytes as they come from the line, in pieces of any size, and hands each complete message to `sink`.
    pub fn feed(&mut self, bytes: &[u8], mut sink: impl FnMut(M)) {
        for byte in bytes {
            // Room is certain: a look at a full buffer always removes something.
            self.bytes[self.length] = *byte;
            self.length += 1;
            self.drain(&mut sink);
        }
    }

    /// What has been seen so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    fn drain(&mut self, sink: &mut impl FnMut(M)) {
        loop {
            match self.look() {
                Look::Incomplete => return,
                Look::Noise => self.skip_byte(),
                Look::Corrupt => {
                    self.counters.checksum_errors = self.counters.checksum_errors.wrapping_add(1);
                    self.skip_byte();
                }
                Look::Frame(length) => {
                    self.deliver(length, sink);
                    self.remove(length);
                }
            }
        }
    }

    fn look(&self) -> Look {
        let bytes = &self.bytes[..self.length];
        if bytes.iter().zip(SYNC).any(|(byte, sync)| *byte != sync) {
            return Look::Noise;
        }
        let Some(payload) = bytes.get(2).map(|length| usize::from(*length)) else { return Look::Incomplete };
        if payload > MAX_PAYLOAD_BYTES {
            return Look::Noise;
        }
        let end = HEADER_BYTES + payload;
        match bytes.get(end..end + TRAILER_BYTES) {
            None => Look::Incomplete,
            Some(crc) if crc16(&bytes[SYNC.len()..end]).to_le_bytes() == crc => Look::Frame(end + TRAILER_BYTES),
            Some(_) => Look::Corrupt,
        }
    }

    fn deliver(&mut self, length: usize, sink: &mut impl FnMut(M)) {
        let (sequence, kind) = (self.bytes[3], self.bytes[4]);
        let missed = self.expected.map_or(0, |expected| sequence.wrapping_sub(expected));
        self.counters.lost = self.counters.lost.wrapping_add(u32::from(missed));
        self.expected = Some(sequence.wrapping_add(1));
        if let Some(message) = M::read(kind, &self.bytes[HEADER_BYTES..length - TRAILER_BYTES]) {
            self.counters.frames = self.counters.frames.wrapping_add(1);
            sink(message);
        } else {
            self.counters.rejected = self.counters.rejected.wrapping_add(1);
        }
    }

    fn skip_byte(&mut self) {
        self.counters.skipped_bytes = self.counters.skipped_bytes.wrapping_add(1);
        self.remove(1);
    }

    fn remove(&mut self, count: usize) {
        self.bytes.copy_within(count..self.length, 0);
        self.length -= count;
    }
}
