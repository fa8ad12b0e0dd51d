//! Text of fixed layout.
#![allow(unsafe_code, reason = "address of unsafe: bytes that are known to be UTF-8")]

use std::fmt;
use std::ops::Deref;

use super::descriptor::{CommObject, Kind, TypeDescriptor};
use super::sequence::Sequence;

/// UTF-8 text. Behaves as a `String`; set anew, it keeps its memory.
#[repr(transparent)]
#[derive(Clone, Default, PartialEq)]
pub struct Text(Sequence<u8>);

impl Text {
    /// An empty text; allocates nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self(Sequence::new())
    }

    /// Replaces the contents.
    pub fn set(&mut self, text: &str) {
        self.0.assign(text.as_bytes());
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        // SAFETY: only `set` and `from` write the bytes, and they copy a `str`; `flat` checks what it reads.
        unsafe { std::str::from_utf8_unchecked(&self.0) }
    }
}

impl Deref for Text {
    type Target = str;
    fn deref(&self) -> &str {
        self.as_str()
    }
}

impl From<&str> for Text {
    fn from(text: &str) -> Self {
        Self(text.as_bytes().to_vec().into())
    }
}

impl From<String> for Text {
    fn from(text: String) -> Self {
        Self(text.into_bytes().into())
    }
}

impl PartialEq<str> for Text {
    fn eq(&self, other: &str) -> bool {
        self.as_str() == other
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl fmt::Display for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self)
    }
}

// SAFETY: size and alignment are the compiler's; a text is a sequence of bytes.
unsafe impl CommObject for Text {
    const DESCRIPTOR: &'static TypeDescriptor =
        &TypeDescriptor::leaf(Kind::Text.opros_name(), Kind::Text, size_of::<Self>(), align_of::<Self>());

    fn empty() -> Self {
        Self::new()
    }
}
