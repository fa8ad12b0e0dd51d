//! Texts of fixed size: what is put together on the recovery path allocates nothing.

use std::fmt;

use serde::Serialize;

use super::limits::{LABEL_BYTES, TEXT_BYTES};

/// A text that cuts instead of growing.
#[derive(Clone, Copy)]
pub struct Text<const N: usize> {
    bytes: [u8; N],
    len: u16,
}

/// A message.
pub type ShortText = Text<TEXT_BYTES>;

/// A name, or the end of a path. Shorter than a message, because a fault may hold two and is copied as a whole.
pub type Label = Text<LABEL_BYTES>;

impl<const N: usize> Text<N> {
    /// No text.
    pub const EMPTY: Self = Self { bytes: [0; N], len: 0 };

    /// The text, cut at a character border.
    #[must_use]
    pub fn new(text: &str) -> Self {
        let mut short = Self::EMPTY;
        // It never fails: it cuts.
        let _ = fmt::Write::write_str(&mut short, text);
        short
    }

    /// The formatted text, cut at a character border.
    #[must_use]
    pub fn of(text: fmt::Arguments<'_>) -> Self {
        let mut short = Self::EMPTY;
        let _ = fmt::write(&mut short, text);
        short
    }

    /// The end of a text, cut at a character border: of a path the end tells more.
    #[must_use]
    pub fn end_of(text: &str) -> Self {
        let mut start = text.len().saturating_sub(N);
        while !text.is_char_boundary(start) {
            start += 1;
        }
        Self::new(&text[start..])
    }

    /// True where nothing is in it.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..usize::from(self.len)]).unwrap_or_default()
    }
}

impl<const N: usize> fmt::Write for Text<N> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let start = usize::from(self.len);
        let mut end = text.len().min(N - start);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        self.bytes[start..start + end].copy_from_slice(&text.as_bytes()[..end]);
        self.len += end as u16;
        Ok(())
    }
}

impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl<const N: usize> Serialize for Text<N> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_cut_text_is_its_beginning_and_a_cut_path_its_end(text in "\\PC{0,20}") {
            type Tiny = Text<16>;
            let (start, end) = (Tiny::new(&text), Tiny::end_of(&text));
            prop_assert!(text.starts_with(start.as_str()) && text.ends_with(end.as_str()));
            let whole = text.len() <= 16;
            prop_assert_eq!(start.as_str() == text, whole);
            prop_assert_eq!(end.as_str() == text, whole);
            // No more is cut than a character.
            prop_assert!(whole || (start.as_str().len() > 12 && end.as_str().len() > 12));
        }
    }
}
