//! A profile file: bytes to text, and text offsets back to line and column.
//!
//! Two of three profiles in the wild declare `euc-kr`, most of them without a single Korean letter. The encoding is found
//! as XML says (byte order mark, then declaration, then UTF-8) and decoded here, before the XML reader sees anything:
//! letting the reader decode would make its offsets those of the file's bytes, and columns would be wrong after the first
//! Korean letter.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Serialize, Serializer};

use encoding_rs::{DecoderResult, EUC_KR, Encoding, UTF_8, UTF_16BE, UTF_16LE};

use super::diagnostic::{Diagnostic, Level};
use super::plan::Location;
use super::xml::is_allowed;
use crate::model::limits;

/// A range of bytes in a source's text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

impl Span {
    /// The span of `length` bytes from `start`.
    #[must_use]
    pub fn new(start: usize, length: usize) -> Self {
        let start = u32::try_from(start).unwrap_or(u32::MAX);
        Self { start, end: start.saturating_add(u32::try_from(length).unwrap_or(0)) }
    }
}

/// A span and the source it is in: what a diagnostic can point at, even after the file was closed.
#[derive(Clone, Debug)]
pub struct Spot {
    /// The source.
    pub source: Arc<Source>,
    /// The range in it.
    pub span: Span,
}

impl Spot {
    /// File, line and column.
    #[must_use]
    pub fn location(&self) -> Location {
        self.source.location(self.span)
    }

    /// A diagnostic here.
    #[must_use]
    pub fn diagnostic(&self, level: Level, message: impl Into<String>) -> Diagnostic {
        Diagnostic::at(level, &self.source, self.span, message)
    }
}

/// A word of a profile and where it stands; serialised as the word alone.
#[derive(Clone, Debug)]
pub struct Word {
    /// The word.
    pub text: String,
    /// Where it stands.
    pub spot: Spot,
}

impl Serialize for Word {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.text)
    }
}

/// What a finding shows of the source.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Excerpt {
    /// The line, or the part of it around the caret.
    pub text: String,
    /// How many characters stand before the caret.
    pub indent: usize,
    /// How many characters the caret underlines.
    pub width: usize,
}

/// The text of one file.
#[derive(Debug)]
pub struct Source {
    path: Arc<PathBuf>,
    text: String,
    line_starts: Vec<u32>,
    /// Characters before each block of [`BLOCK`] bytes, so that a column in a line of megabytes is found at once.
    characters: Vec<u32>,
}

/// See [`Source::characters`].
const BLOCK: usize = 1024;

impl Source {
    /// Reads and decodes `path`.
    ///
    /// # Errors
    /// One diagnostic: not readable, not a regular file, too large, or not in its declared encoding.
    pub fn read(path: &Path) -> Result<Self, Diagnostic> {
        let bytes = read_bytes(path).map_err(|message| Diagnostic::of_file(Level::Error, path, message))?;
        Self::decode(path, &bytes)
    }

    /// Decodes `bytes` as the content of `path`.
    ///
    /// # Errors
    /// One diagnostic: unknown encoding, undecodable bytes, or a character that XML forbids.
    pub fn decode(path: &Path, bytes: &[u8]) -> Result<Self, Diagnostic> {
        let (encoding, bom_length) = find_encoding(bytes)
            .map_err(|message| Diagnostic::of_file(Level::Error, path, message).with_hint(KNOWN_ENCODINGS))?;
        let body = bytes.get(bom_length..).unwrap_or_default();
        let (text, bad_at) = decode_text(encoding, body);
        let source = Self::from_text(path, text);
        if let Some(bad_at) = bad_at {
            return Err(source.undecodable(encoding, body, bad_at));
        }
        source.refuse_forbidden_characters()?;
        Ok(source)
    }

    /// A source from text that is already decoded.
    #[must_use]
    pub fn from_text(path: &Path, text: String) -> Self {
        let mut line_starts = vec![0];
        let bytes = text.as_bytes();
        for (index, byte) in bytes.iter().enumerate() {
            let ends_line = *byte == b'\n' || (*byte == b'\r' && bytes.get(index + 1) != Some(&b'\n'));
            if ends_line {
                line_starts.push(u32::try_from(index + 1).unwrap_or(u32::MAX));
            }
        }
        let mut characters = vec![0];
        for block in bytes.chunks(BLOCK) {
            let before = characters.last().copied().unwrap_or(0);
            characters.push(before + u32::try_from(count_characters(block)).unwrap_or(0));
        }
        Self { path: Arc::new(path.to_path_buf()), text, line_starts, characters }
    }

    /// The decoded text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The file's path, as it was named.
    #[must_use]
    pub const fn path(&self) -> &Arc<PathBuf> {
        &self.path
    }

    /// File, line and column of a span's begin.
    #[must_use]
    pub fn location(&self, span: Span) -> Location {
        let line = self.line_index(span.start);
        let start = self.line_starts.get(line).copied().unwrap_or(0) as usize;
        let column = self.characters_before(span.start as usize).saturating_sub(self.characters_before(start)) + 1;
        Location {
            file: Arc::clone(&self.path),
            line: u32::try_from(line + 1).unwrap_or(u32::MAX),
            column: u32::try_from(column).unwrap_or(u32::MAX),
        }
    }

    /// The line that holds `span`, without its line end; of a very long one the part around the span.
    #[must_use]
    pub fn excerpt(&self, span: Span) -> Excerpt {
        let line = self.line_index(span.start);
        let start = self.line_starts.get(line).copied().unwrap_or(0) as usize;
        let end = self.line_starts.get(line + 1).map_or(self.text.len(), |next| *next as usize);
        let whole = self.text.get(start..end).unwrap_or_default().trim_end_matches(['\r', '\n']);
        let at = (span.start as usize).clamp(start, start + whole.len());
        let before = self.text.get(start..at).unwrap_or_default();
        let after = self.text.get(at..start + whole.len()).unwrap_or_default();
        // Only as many characters as are shown are looked at: a file may be one line of megabytes.
        let short = before.len() + after.len() <= limits::EXCERPT_CHARS;
        let room = if short { limits::EXCERPT_CHARS } else { limits::EXCERPT_CHARS / 2 };
        let kept = before.char_indices().rev().take(room).last().map_or(before.len(), |(index, _)| index);
        let before = before.get(kept..).unwrap_or_default();
        let shown: String = after.chars().take(room).collect();
        let width = self.text.get(at..(span.end as usize).min(at + shown.len())).map_or(1, |part| part.chars().count());
        Excerpt { indent: before.chars().count(), width: width.max(1), text: format!("{before}{shown}") }
    }

    fn characters_before(&self, offset: usize) -> usize {
        let offset = offset.min(self.text.len());
        let block = offset / BLOCK;
        let rest = self.text.as_bytes().get(block * BLOCK..offset).unwrap_or_default();
        self.characters.get(block).copied().unwrap_or(0) as usize + count_characters(rest)
    }

    fn line_index(&self, offset: u32) -> usize {
        self.line_starts.partition_point(|start| *start <= offset).saturating_sub(1)
    }

    fn undecodable(&self, encoding: &'static Encoding, body: &[u8], bad_at: usize) -> Diagnostic {
        let byte = body.get(bad_at).copied().unwrap_or(0);
        let span = Span::new(self.text.len(), 0);
        let message = format!("byte {byte:#04x} is not {}", encoding.name());
        let korean = encoding != EUC_KR && EUC_KR.decode_without_bom_handling_and_without_replacement(body).is_some();
        let hint = if korean {
            "the file decodes as euc-kr: declare it, <?xml version=\"1.0\" encoding=\"euc-kr\"?>"
        } else {
            "declare the encoding that the file is written in, or save it as UTF-8"
        };
        Diagnostic::at(Level::Error, self, span, message).with_hint(hint)
    }

    fn refuse_forbidden_characters(&self) -> Result<(), Diagnostic> {
        let Some((at, c)) = self.text.char_indices().find(|(_, c)| !is_allowed(*c)) else { return Ok(()) };
        let message = format!("character U+{:04X} is not allowed in XML", u32::from(c));
        Err(Diagnostic::at(Level::Error, self, Span::new(at, c.len_utf8()), message)
            .with_hint("remove it; XML knows no control characters except tab and line ends"))
    }
}

fn shortened(label: &str) -> String {
    label.chars().take(limits::NAME_CHARS).collect()
}

/// Bytes that begin a character of UTF-8.
fn count_characters(bytes: &[u8]) -> usize {
    bytes.iter().filter(|byte| **byte & 0xc0 != 0x80).count()
}

const KNOWN_ENCODINGS: &str = "known are UTF-8, UTF-16, euc-kr (cp949) and every other encoding of the web's list";

/// Only a regular file is opened: opening a pipe would block for ever, reading a device would never end.
fn read_bytes(path: &Path) -> Result<Vec<u8>, String> {
    let kind = std::fs::metadata(path).map_err(|error| format!("cannot be read: {error}"))?;
    if kind.is_dir() {
        return Err("is a directory, not a profile file".to_owned());
    }
    if !kind.is_file() {
        return Err("is not a regular file".to_owned());
    }
    let file = File::open(path).map_err(|error| format!("cannot be read: {error}"))?;
    let mut bytes = Vec::new();
    let read = file.take(limits::PROFILE_FILE_BYTES + 1).read_to_end(&mut bytes);
    read.map_err(|error| format!("cannot be read: {error}"))?;
    if bytes.len() as u64 > limits::PROFILE_FILE_BYTES {
        return Err(format!("is larger than the {} MiB that a profile may have", limits::PROFILE_FILE_BYTES >> 20));
    }
    Ok(bytes)
}

fn find_encoding(bytes: &[u8]) -> Result<(&'static Encoding, usize), String> {
    if let Some(found) = Encoding::for_bom(bytes) {
        return Ok(found);
    }
    match bytes {
        [b'<', 0, ..] => return Ok((UTF_16LE, 0)),
        [0, b'<', ..] => return Ok((UTF_16BE, 0)),
        _ => {}
    }
    let Some(label) = declared_encoding(bytes) else { return Ok((UTF_8, 0)) };
    let encoding = match label.to_ascii_lowercase().as_str() {
        // Names of the same Korean code page that the web's list does not have.
        "cp949" | "ms949" | "uhc" | "x-windows-949" => Some(EUC_KR),
        // Some labels of the web's list mean that nothing can be decoded.
        _ => Encoding::for_label_no_replacement(label.as_bytes()),
    };
    match encoding {
        Some(found) if found == UTF_16LE || found == UTF_16BE => {
            Err(format!("declares encoding \"{}\", but its first bytes are not UTF-16", shortened(&label)))
        }
        Some(found) => Ok((found, 0)),
        None => Err(format!("declares encoding \"{}\", which cannot be read", shortened(&label))),
    }
}

/// Where an XML declaration must have ended.
const DECLARATION_BYTES: usize = 16 << 10;

/// The pseudo-attribute `encoding` of `<?xml ... ?>`, which by rule is ASCII.
fn declared_encoding(bytes: &[u8]) -> Option<String> {
    let head = bytes.get(..bytes.len().min(DECLARATION_BYTES))?;
    let text: String = head.iter().map(|byte| char::from(*byte)).collect();
    let declaration = text.strip_prefix("<?xml")?.split_once("?>")?.0.to_owned();
    let after = declaration.split_once("encoding")?.1.trim_start().strip_prefix('=')?.trim_start();
    let quote = after.chars().next().filter(|c| matches!(c, '"' | '\''))?;
    let label = after.get(1..)?.split_once(quote)?.0.trim();
    Some(label.to_owned())
}

/// The text, and where the first undecodable byte stands; the text then ends before it.
fn decode_text(encoding: &'static Encoding, body: &[u8]) -> (String, Option<usize>) {
    let mut decoder = encoding.new_decoder_without_bom_handling();
    let capacity = decoder.max_utf8_buffer_length_without_replacement(body.len()).unwrap_or(body.len());
    let mut text = String::with_capacity(capacity);
    let (result, read) = decoder.decode_to_string_without_replacement(body, &mut text, true);
    match result {
        DecoderResult::InputEmpty => (text, None),
        DecoderResult::Malformed(bad, after) => {
            (text, Some(read.saturating_sub(usize::from(bad) + usize::from(after))))
        }
        DecoderResult::OutputFull => (text, Some(read)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(bytes: &[u8]) -> Result<Source, Diagnostic> {
        Source::decode(Path::new("a.xml"), bytes)
    }

    #[test]
    fn korean_code_page_utf16_and_byte_order_marks_are_read() {
        let (korean, _, _) = EUC_KR.encode("<?xml version=\"1.0\" encoding=\"CP949\"?><name>경기도</name>");
        assert!(decode(&korean).is_ok_and(|source| source.text().contains("경기도")));
        assert!(decode(b"\xef\xbb\xbf<a/>").is_ok_and(|source| source.text() == "<a/>"));
        assert!(decode(b"\xff\xfe<\0a\0/\0>\0").is_ok_and(|source| source.text() == "<a/>"));
        assert!(decode(b"\0<\0a\0/\0>").is_ok_and(|source| source.text() == "<a/>"));
    }

    #[test]
    fn undecodable_bytes_are_located_and_the_likely_encoding_named() {
        let error = decode(b"<a>\r\nab\xb0\xe6</a>").err();
        let error = error.unwrap_or_else(|| Diagnostic::of_file(Level::Note, Path::new(""), "decoded"));
        assert_eq!((error.location.line, error.location.column), (2, 3));
        assert!(error.hint.is_some_and(|hint| hint.contains("euc-kr")));
    }

    #[test]
    fn all_three_line_ends_count_and_columns_are_characters() {
        let source = Source::from_text(Path::new("a.xml"), "a\r\nb\rc\n가나x".to_owned());
        let at = u32::try_from(source.text().find('x').unwrap_or(0)).unwrap_or(0);
        let location = source.location(Span { start: at, end: at + 1 });
        assert_eq!((location.line, location.column), (4, 3));
    }

    #[test]
    fn control_characters_and_unknown_encodings_are_refused() {
        assert!(decode(b"<a>\x01</a>").is_err());
        assert!(decode(b"<?xml version='1.0' encoding='klingon'?><a/>").is_err());
        assert!(decode(b"<?xml version='1.0' encoding='utf-16'?><a/>").is_err());
    }
}
