//! A companion of the latch's file in memory that outlives the process, and not the machine: a word of a file on a tmpfs, mapped
//! beforehand, so that whoever raises the emergency stop says so by one store before anybody is told, and waits for no disk. A
//! `kill -9` in the middle of a raise loses nothing then. After a reboot it is gone, and the file on the disk is what counts.
//!
//! It lies in a directory of the user's own, which nobody else may enter, and is named after the journal. Whose journal's
//! directory is gone is removed by the next start, or they would be there until the next reboot.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, FileExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use crate::sys::mapping::{PAGE, Word};

/// A tmpfs wherever there is a C library with shared memory.
const HOME: &str = "/dev/shm";

/// What it begins with, before the path of the file that it accompanies; the word is in the page after that.
const HEAD: &str = "framework-daemon latch ";

/// The word.
#[derive(Debug)]
pub(super) struct Companion {
    path: PathBuf,
    word: Word,
}

impl Companion {
    /// What lies there for the latch in that file: whether it was latched. Nothing is written yet: the disk is to know first.
    pub(super) fn peek(latch: &Path) -> bool {
        place(Path::new(HOME), latch).and_then(|path| peek(&path)).unwrap_or(false)
    }

    /// Makes it; `latched`: what it says.
    ///
    /// # Errors
    /// Where there is no such memory, or somebody else has put something there.
    pub(super) fn make(latch: &Path, latched: bool) -> io::Result<Self> {
        Self::make_in(Path::new(HOME), latch, latched)
    }

    fn make_in(home: &Path, latch: &Path, latched: bool) -> io::Result<Self> {
        let path = place(home, latch)?;
        path.parent().into_iter().for_each(sweep);
        let file = options().create(true).truncate(false).open(&path)?;
        check(&file)?;
        let head = format!("{HEAD}{}\n", latch.display());
        file.write_all_at(&head.as_bytes()[..head.len().min(PAGE)], 0)?;
        let word = Word::create(&file, PAGE as u64)?;
        let companion = Self { path, word };
        companion.say(latched);
        Ok(companion)
    }

    /// One store.
    pub(super) fn say(&self, latched: bool) {
        self.word.get().store(u64::from(latched), Ordering::SeqCst);
    }

    /// It is not needed any more.
    pub(super) fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

fn options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true).write(true).mode(0o600).custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK);
    options
}

fn peek(path: &Path) -> io::Result<bool> {
    let file = options().open(path)?;
    check(&file)?;
    let mut word = [0; 8];
    file.read_exact_at(&mut word, PAGE as u64)?;
    Ok(word != [0; 8])
}

/// Somebody else's is not believed.
fn check(file: &File) -> io::Result<()> {
    let found = file.metadata()?;
    let is_own = found.is_file() && found.uid() == own_user() && found.nlink() == 1;
    if is_own { Ok(()) } else { Err(io::Error::other("it is somebody else's")) }
}

fn own_user() -> u32 {
    nix::unistd::geteuid().as_raw()
}

/// Where it lies, in a directory that is made where there is none.
fn place(home: &Path, latch: &Path) -> io::Result<PathBuf> {
    let directory = home.join(format!("framework-daemon-{}", own_user()));
    match DirBuilder::new().mode(0o700).create(&directory) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    let found = directory.symlink_metadata()?;
    if !found.is_dir() || found.uid() != own_user() || found.permissions().mode() & 0o077 != 0 {
        return Err(io::Error::other(format!("{} is not this user's alone", directory.display())));
    }
    Ok(directory.join(format!("{:016x}", hash(latch.as_os_str().as_encoded_bytes()))))
}

/// FNV-1a, 64 bits: the same in every build.
fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Removes those whose journal's directory is gone.
fn sweep(directory: &Path) {
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        if latch_of(&entry.path()).is_some_and(|latch| latch.parent().is_some_and(|above| !above.exists())) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// The file that a companion accompanies.
fn latch_of(companion: &Path) -> Option<PathBuf> {
    let mut head = vec![0; PAGE];
    let len = options().open(companion).ok()?.read_at(&mut head, 0).ok()?;
    let line = head[..len].split(|byte| *byte == b'\n').next()?;
    Some(PathBuf::from(std::str::from_utf8(line).ok()?.strip_prefix(HEAD)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn home() -> (tempfile::TempDir, PathBuf) {
        let home = tempfile::tempdir().unwrap();
        let latch = home.path().join("state/journal.emergency");
        std::fs::create_dir(home.path().join("state")).unwrap();
        (home, latch)
    }

    fn peek_in(home: &Path, latch: &Path) -> bool {
        place(home, latch).and_then(|path| peek(&path)).unwrap_or(false)
    }

    #[test]
    fn what_is_stored_is_found_by_the_next() {
        let (home, latch) = home();
        assert!(!peek_in(home.path(), &latch));
        let companion = Companion::make_in(home.path(), &latch, false).unwrap();
        assert!(!peek_in(home.path(), &latch));
        companion.say(true);
        drop(companion);
        assert!(peek_in(home.path(), &latch));
        assert!(!peek_in(home.path(), &latch.with_extension("other")), "each has its own");
        Companion::make_in(home.path(), &latch, true).unwrap().remove();
        assert!(!peek_in(home.path(), &latch));
    }

    #[test]
    fn what_others_can_write_is_not_used() {
        let (home, latch) = home();
        let path = place(home.path(), &latch).unwrap();
        std::os::unix::fs::symlink(home.path().join("elsewhere"), &path).unwrap();
        assert!(Companion::make_in(home.path(), &latch, true).is_err(), "a link");
        std::fs::remove_file(&path).unwrap();
        let open = std::fs::Permissions::from_mode(0o770);
        std::fs::set_permissions(path.parent().unwrap(), open).unwrap();
        assert!(Companion::make_in(home.path(), &latch, true).is_err(), "a directory of many");
    }

    #[test]
    fn one_whose_journal_is_gone_is_removed() {
        let (home, latch) = home();
        drop(Companion::make_in(home.path(), &latch, true).unwrap());
        let other = home.path().join("other.emergency");
        drop(Companion::make_in(home.path(), &other, false).unwrap());
        assert!(peek_in(home.path(), &latch));
        std::fs::remove_dir(home.path().join("state")).unwrap();
        drop(Companion::make_in(home.path(), &other, false).unwrap());
        assert!(!peek_in(home.path(), &latch));
    }
}
