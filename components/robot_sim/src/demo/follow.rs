//! Follows a file of JSON lines that another process is writing.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;

/// Reads the lines that have come since the last look.
pub struct Follower {
    path: PathBuf,
    offset: u64,
}

impl Follower {
    /// Follows `path` from its beginning. It need not exist yet.
    #[must_use]
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), offset: 0 }
    }

    /// All complete new lines that are of the wanted form. Lines of other forms are passed over: a journal holds more
    /// kinds than the demo shows. An unfinished last line waits for the next look.
    pub fn look<T: DeserializeOwned>(&mut self) -> Vec<T> {
        let Some(text) = self.fresh() else { return Vec::new() };
        let complete = text.iter().rposition(|byte| *byte == b'\n').map_or(0, |last| last + 1);
        self.offset += complete as u64;
        text[..complete].split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect()
    }

    fn fresh(&self) -> Option<Vec<u8>> {
        let mut file = File::open(&self.path).ok()?;
        file.seek(SeekFrom::Start(self.offset)).ok()?;
        let mut text = Vec::new();
        file.read_to_end(&mut text).ok()?;
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::Follower;

    #[test]
    fn half_a_line_waits_and_foreign_lines_are_passed_over() {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        let mut follower = Follower::new(file.path());
        assert_eq!(follower.look::<u32>(), [0; 0]);
        file.write_all(b"1\n\"two\"\n3").unwrap();
        assert_eq!(follower.look::<u32>(), [1]);
        file.write_all(b"4\n").unwrap();
        assert_eq!(follower.look::<u32>(), [34]);
    }
}
