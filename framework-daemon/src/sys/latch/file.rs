//! The file of the latch, open and as large as it will ever be, so that a raise costs one small write into it and succeeds on
//! a full disk. Where somebody removed it, or put another one into its place, a new one is made.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use super::super::place;
use super::record::{self, Record};

/// What the run before left.
#[derive(Clone, Debug, PartialEq)]
pub enum Left {
    /// Nothing that counts.
    Free,
    /// It is latched.
    Latched(Record),
    /// Nobody knows: it counts as latched.
    Unknown(String),
}

/// The file.
#[derive(Debug)]
pub(super) struct Kept {
    path: PathBuf,
    file: Option<File>,
    /// What it says, or would: of the run that latched it, or of this one.
    pub(super) record: Record,
    /// What it said of the run before, where that was not latched.
    pub(super) before: Record,
    /// What it says of this run.
    pub(super) own: Record,
    /// Why it does not say it.
    pub(super) failure: Option<String>,
}

impl Kept {
    pub(super) fn at(path: &Path, own: Record) -> Self {
        Self { path: path.to_owned(), file: None, record: own.clone(), before: own.clone(), own, failure: None }
    }

    /// Opens the file, or makes it; what it says stays. `missed`: where there is none, there should be one.
    pub(super) fn open(path: &Path, own: Record, missed: bool) -> (Self, Left) {
        let mut kept = Self::at(path, own);
        // A link that leads nowhere is there, too.
        if path.symlink_metadata().is_err_and(|error| error.kind() == io::ErrorKind::NotFound) {
            let _ = kept.say(missed);
            return (kept, if missed { Left::Unknown("somebody removed it".to_owned()) } else { Left::Free });
        }
        let left = kept.read().unwrap_or_else(|error| Left::Unknown(error.to_string()));
        match &left {
            Left::Free => _ = kept.say(false),
            Left::Latched(record) => kept.record = record.clone(),
            // Somebody sees to it that the next run can read it.
            Left::Unknown(reason) => kept.failure = Some(reason.clone()),
        }
        (kept, left)
    }

    /// What it says; it stays open where it can be written, too.
    pub(super) fn read(&mut self) -> io::Result<Left> {
        // Not blocking: a pipe without a writer would hang here for ever.
        let open = |write| OpenOptions::new().read(true).write(write).custom_flags(libc::O_NONBLOCK).open(&self.path);
        let (mut file, failure) = match open(true) {
            Ok(file) => (file, None),
            Err(error) => (open(false)?, Some(error.to_string())),
        };
        if !file.metadata()?.is_file() {
            return Ok(Left::Unknown("it is no regular file".to_owned()));
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        self.file = failure.is_none().then_some(file);
        self.failure = failure;
        Ok(match record::decode(&bytes) {
            Ok((before, false)) => {
                self.before = before;
                Left::Free
            }
            Ok((record, true)) => Left::Latched(record),
            Err(reason) => Left::Unknown(reason),
        })
    }

    /// Where it is.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Says at once that it is latched: one write, no allocation.
    pub(super) fn shout(&self) {
        if let Some(file) = &self.file {
            // Said again, and looked after, by `say`.
            let _ = file.write_all_at(record::LATCHED, 0);
        }
    }

    /// Writes what it is to say; when this returns it is on the disk.
    ///
    /// # Errors
    /// When it cannot be written; [`Self::failure`] has it, too.
    pub(super) fn say(&mut self, latched: bool) -> io::Result<()> {
        let bytes = record::encode(&self.record, latched);
        let result = match self.file.as_ref().filter(|file| place::holds(&self.path, file)) {
            Some(file) => over(file, &bytes),
            None => self.anew(&bytes),
        };
        self.failure = result.as_ref().err().map(ToString::to_string);
        result
    }

    /// What somebody did to the file since it was written; `None`: nothing, or it could not be written, which is told elsewhere.
    pub(super) fn meddled(&self, latched: bool) -> Option<&'static str> {
        let file = self.file.as_ref().filter(|_| self.failure.is_none())?;
        if !place::holds(&self.path, file) {
            return Some("somebody moved or removed it");
        }
        let told = record::encode(&self.record, latched);
        let mut found = vec![0; told.len() + 1];
        let len = file.read_at(&mut found, 0).unwrap_or_default();
        (found[..len] != told).then_some("somebody wrote into it")
    }

    /// Under another name first: whoever looks finds the one before or this one, whole.
    fn anew(&mut self, bytes: &[u8]) -> io::Result<()> {
        let new = place::suffixed(&self.path, ".new");
        let made = make(&new, bytes).and_then(|file| std::fs::rename(&new, &self.path).map(|()| file));
        let file = made.inspect_err(|_| _ = std::fs::remove_file(&new))?;
        self.file = Some(file);
        let directory = self.path.parent().filter(|directory| !directory.as_os_str().is_empty());
        File::open(directory.unwrap_or(Path::new(".")))?.sync_all()
    }
}

fn over(file: &File, bytes: &[u8]) -> io::Result<()> {
    file.write_all_at(bytes, 0)?;
    file.set_len(bytes.len() as u64)?;
    file.sync_all()
}

fn make(path: &Path, bytes: &[u8]) -> io::Result<File> {
    let mut file = OpenOptions::new().create(true).truncate(true).read(true).write(true).open(path)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use super::super::record::Cause;
    use super::*;

    fn own() -> Record {
        Record::new("/robots/one".into(), vec!["motors".into()])
    }

    fn scratch() -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("latch");
        (directory, path)
    }

    #[test]
    fn what_is_said_is_found_and_a_shout_suffices() {
        let (_directory, path) = scratch();
        let (mut kept, left) = Kept::open(&path, own(), false);
        assert_eq!((left, kept.failure.as_deref()), (Left::Free, None));
        assert_eq!(Kept::open(&path, own(), false).1, Left::Free);
        kept.shout();
        assert_eq!(Kept::open(&path, own(), false).1, Left::Latched(own()));
        let cause = Cause { slot: "motors".into(), symptom: "crash.segv".into(), fault: 3, wall: 1.5 };
        kept.record.cause = Some(cause);
        kept.say(true).unwrap();
        assert_eq!(Kept::open(&path, Record::default(), false).1, Left::Latched(kept.record.clone()));
        kept.say(false).unwrap();
        assert_eq!(Kept::open(&path, own(), false).1, Left::Free);
    }

    #[test]
    fn one_that_is_missed_counts_as_latched() {
        let (_directory, path) = scratch();
        assert!(matches!(Kept::open(&path, own(), true).1, Left::Unknown(_)));
        assert_eq!(Kept::open(&path, own(), true).1, Left::Latched(own()));
    }

    #[test]
    fn what_somebody_removed_or_replaced_is_made_anew() {
        let (_directory, path) = scratch();
        let (mut kept, _) = Kept::open(&path, own(), false);
        std::fs::remove_file(&path).unwrap();
        kept.say(true).unwrap();
        assert_eq!(Kept::open(&path, own(), false).1, Left::Latched(own()));
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, "other").unwrap();
        kept.say(true).unwrap();
        assert_eq!(Kept::open(&path, own(), false).1, Left::Latched(own()));
    }

    #[test]
    fn what_somebody_does_to_it_is_found() {
        let (_directory, path) = scratch();
        let (mut kept, _) = Kept::open(&path, own(), false);
        let old = std::fs::read(&path).unwrap();
        assert_eq!(kept.meddled(false), None);
        kept.shout();
        assert_eq!(kept.meddled(true), None, "that was the daemon itself");
        for (latched, bytes) in
            [(true, old.as_slice()), (true, b""), (false, b"{"), (true, &[old.as_slice(), b" "].concat())]
        {
            kept.say(latched).unwrap();
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(kept.meddled(latched), Some("somebody wrote into it"));
        }
        std::fs::remove_file(&path).unwrap();
        assert_eq!(kept.meddled(true), Some("somebody moved or removed it"));
        kept.say(true).unwrap();
        assert_eq!(kept.meddled(true), None);
    }

    #[test]
    fn what_cannot_be_read_is_latched() {
        let (directory, path) = scratch();
        for text in ["", "{", "{\"latched\":0}", "not latched"] {
            std::fs::write(&path, text).unwrap();
            assert!(matches!(Kept::open(&path, own(), false).1, Left::Unknown(_)), "{text:?}");
        }
        std::fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink(directory.path().join("nowhere"), &path).unwrap();
        assert!(matches!(Kept::open(&path, own(), false).1, Left::Unknown(_)));
        std::fs::remove_file(&path).unwrap();
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRUSR | nix::sys::stat::Mode::S_IWUSR).unwrap();
        assert_eq!(Kept::open(&path, own(), false).1, Left::Unknown("it is no regular file".into()));
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        let (mut kept, left) = Kept::open(&path, own(), false);
        assert!(matches!(left, Left::Unknown(_)), "{left:?}");
        assert!(kept.say(false).is_err() && kept.failure.is_some(), "a directory is not replaced");
    }

    #[test]
    fn where_none_can_be_made_it_is_free_and_says_so() {
        let (_directory, path) = scratch();
        let (mut kept, left) = Kept::open(&path.join("deep"), own(), false);
        assert_eq!(left, Left::Free);
        assert!(kept.failure.is_some());
        std::fs::create_dir(&path).unwrap();
        kept.say(true).unwrap();
        assert_eq!(kept.failure, None, "tried again it is kept");
        assert_eq!(Kept::open(&path.join("deep"), own(), false).1, Left::Latched(own()));
    }
}
