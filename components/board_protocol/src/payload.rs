//! Little-endian fields in and out of a payload; every read is checked, so no bytes can make a reader panic.

use crate::MAX_PAYLOAD_BYTES;

/// What can travel in a frame. Implemented by [`crate::Command`] and [`crate::Telemetry`].
pub trait Message: Sized {
    /// The frame's kind byte.
    fn kind(&self) -> u8;
    /// Writes the fields after one another.
    fn write(&self, payload: &mut PayloadWriter);
    /// Reads a message back. `None` when the kind is unknown, the length is wrong or a value makes no sense.
    fn read(kind: u8, payload: &[u8]) -> Option<Self>;
}

/// Collects a payload. Fields beyond [`MAX_PAYLOAD_BYTES`] are a programming error caught by the encoder's tests;
/// they are left out rather than panicking on a board.
pub struct PayloadWriter {
    bytes: [u8; MAX_PAYLOAD_BYTES],
    length: usize,
}

impl PayloadWriter {
    pub(crate) const fn new() -> Self {
        Self { bytes: [0; MAX_PAYLOAD_BYTES], length: 0 }
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Appends raw bytes.
    pub fn put(&mut self, field: &[u8]) {
        if let Some(room) = self.bytes.get_mut(self.length..self.length + field.len()) {
            room.copy_from_slice(field);
            self.length += field.len();
        }
    }
}

/// Reads the fields of a payload in order.
pub struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    /// Begins at the first byte of `payload`.
    #[must_use]
    pub const fn of(payload: &'a [u8]) -> Self {
        Self(payload)
    }

    /// The next `N` bytes, or `None` when fewer are left.
    pub fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (field, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*field)
    }

    /// The next unsigned 32-bit number.
    pub fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    /// The next signed 32-bit number.
    pub fn i32(&mut self) -> Option<i32> {
        self.take().map(i32::from_le_bytes)
    }

    /// The next unsigned 16-bit number.
    pub fn u16(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    /// The next byte.
    pub fn u8(&mut self) -> Option<u8> {
        self.take().map(u8::from_le_bytes)
    }

    /// The next 32-bit float; `None` also when it is not a finite number, which no motor can follow.
    pub fn f32(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes).filter(|number| number.is_finite())
    }

    /// `message` if every byte has been read.
    pub fn end<M>(self, message: M) -> Option<M> {
        self.0.is_empty().then_some(message)
    }
}
