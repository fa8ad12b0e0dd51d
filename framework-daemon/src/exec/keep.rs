//! The file that checkpoints lie in, so that they outlive the daemon: opened, read, and given out in rooms, one for each slot.
//!
//! It lies beside the journal (`journal.jsonl.checkpoints`) and is removed when a run ends in order. So it is there when the
//! run before was killed, crashed, was left at once by a second signal, or asked for a restart because memory was suspect:
//! then slots go on from what they find in it. A new file is built under another name, with what is taken up, and
//! takes the old one's place before anything runs; until then a start that comes to nothing changes nothing.
//!
//! Executors write into mapped memory, without a system call; rooms are made when instances are. Pages of a file are
//! written back by the kernel every so often, and on a slow disk the next write to such a page may wait for it: where that
//! counts, the file belongs onto a `tmpfs` (`--checkpoints`). Who cuts the file short while it is in use takes from
//! the next run what it would have gone on from, and nothing else: see [`crate::sys::mapping`].

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use nix::fcntl::{Flock, FlockArg};

use super::kept::{self, Frame, Kept, Origin, Whose};
use crate::model::limits::{CHECKPOINT_FILE_BYTES, CHECKPOINT_TRIES};
use crate::sys::clock;
use crate::sys::copy::Sum;
use crate::sys::mapping::{Mapping, PAGE};
use crate::sys::place::suffixed;

/// The file of checkpoints of this run.
#[derive(Debug)]
pub struct Keep {
    path: PathBuf,
    desk: Mutex<Desk>,
}

#[derive(Debug)]
struct Desk {
    file: Flock<File>,
    /// The file before, as long as nothing has taken its place; and its lock as long as this one lives.
    _before: Flock<File>,
    in_place: bool,
    end: u64,
    /// Rooms that were given back: where, and how long.
    free: Vec<(u64, usize)>,
    kept: HashMap<String, Kept>,
    taken_up: Vec<TakenUp>,
}

/// A checkpoint that a slot goes on from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TakenUp {
    /// The slot.
    pub slot: String,
    /// Age of the checkpoint in nanoseconds.
    pub age_ns: u64,
}

impl Keep {
    /// Opens the file; what the run before left is read, unless it is to be forgotten.
    ///
    /// # Errors
    /// When there is no room for it, another daemon has it, or it cannot be made.
    pub fn open(path: &Path, profiles: &Path, forget: bool) -> io::Result<Arc<Self>> {
        let mut before = lock(open(path, false)?)?;
        let origin = origin(profiles);
        let kept = if forget { Vec::new() } else { read(&mut before, path, &origin) };
        let file = lock(open(&new_name(path), true)?)?;
        let headed = nix::fcntl::posix_fallocate(&*file, 0, PAGE as i64)
            .map_err(io::Error::from)
            .and_then(|()| file.write_all_at(&kept::header(&origin), 0));
        headed.inspect_err(|_| _ = std::fs::remove_file(new_name(path)))?;
        let kept = kept.into_iter().map(|kept| (kept.slot.clone(), kept)).collect();
        let (free, taken_up) = (Vec::new(), Vec::new());
        let desk = Desk { file, _before: before, in_place: false, end: PAGE as u64, free, kept, taken_up };
        Ok(Arc::new(Self { path: path.to_owned(), desk: Mutex::new(desk) }))
    }

    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the run before left of that slot, if an instance with these regions can go on from it. What cannot is told in the log.
    #[must_use]
    pub fn take(&self, whose: Whose<'_>, regions: &[(&'static str, usize)]) -> Option<Kept> {
        let kept = self.desk().kept.remove(whose.slot)?;
        match reason_against(&kept, whose, regions) {
            None => Some(kept),
            Some(reason) => {
                tracing::warn!("slot {}: its checkpoint of the run before is not taken up: {reason}", whose.slot);
                None
            }
        }
    }

    /// A slot went on from what the run before left.
    pub fn tell(&self, slot: &str, age_ns: u64) {
        self.desk().taken_up.push(TakenUp { slot: slot.to_owned(), age_ns });
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The slots that went on, as far as they were started.
    #[must_use]
    pub fn taken_up(&self) -> Vec<TakenUp> {
        self.desk().taken_up.clone()
    }

    /// Room for copies of `bytes` bytes.
    ///
    /// # Errors
    /// When the disk is full, or the file would be too large.
    pub fn room(self: &Arc<Self>, bytes: usize, table: usize) -> io::Result<Room> {
        let frame = Frame::new(bytes, table);
        let mut desk = self.desk();
        let freed = desk.free.iter().position(|(_, len)| *len == frame.bytes());
        let offset = match freed {
            Some(index) => desk.free.swap_remove(index).0,
            None => desk.end,
        };
        let end = offset + frame.bytes() as u64;
        if end > CHECKPOINT_FILE_BYTES {
            return Err(io::Error::other(format!("the file would be longer than {} MiB", CHECKPOINT_FILE_BYTES >> 20)));
        }
        let mapping = Mapping::create(&desk.file, offset, frame.bytes())?;
        desk.end = desk.end.max(end);
        Ok(Room { keep: Arc::clone(self), mapping, frame, offset })
    }

    /// All slots have their rooms: the file takes the place of the one before.
    pub fn put_in_place(&self) {
        let mut desk = self.desk();
        for (slot, _) in std::mem::take(&mut desk.kept) {
            tracing::warn!(
                "slot {slot}: its checkpoint of the run before is not taken up: there is no such slot any more, or it keeps none"
            );
        }
        if desk.in_place {
            return;
        }
        match std::fs::rename(new_name(&self.path), &self.path) {
            Ok(()) => desk.in_place = true,
            Err(error) => {
                tracing::warn!("checkpoints {}: {error}; they do not outlive the daemon", self.path.display());
            }
        }
    }

    /// The run ends in order: the next one begins anew.
    pub fn forget(&self) {
        if let Err(error) = std::fs::remove_file(&self.path) {
            tracing::warn!("checkpoints {}: {error}; remove it, or the next run goes on from it", self.path.display());
        }
    }
}

impl Drop for Keep {
    fn drop(&mut self) {
        // A start that came to nothing leaves what it found; where that was nothing, nothing.
        if !self.desk().in_place {
            let _ = std::fs::remove_file(new_name(&self.path));
            if std::fs::metadata(&self.path).is_ok_and(|file| file.len() == 0) {
                let _ = std::fs::remove_file(&self.path);
            }
        }
    }
}

/// Where the file lies that belongs to that journal.
#[must_use]
pub fn beside(journal: &Path) -> PathBuf {
    suffixed(journal, ".checkpoints")
}

fn new_name(path: &Path) -> PathBuf {
    suffixed(path, ".new")
}

fn open(path: &Path, truncate: bool) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(truncate).mode(0o600);
    let file = options.custom_flags(libc::O_NONBLOCK | libc::O_NOFOLLOW).open(path)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(io::Error::other("it is no regular file")) }
}

fn lock(file: File) -> io::Result<Flock<File>> {
    Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, error)| match error {
        nix::Error::EWOULDBLOCK => io::Error::other("another daemon keeps its checkpoints in it"),
        other => other.into(),
    })
}

fn origin(profiles: &Path) -> Origin {
    let boot = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
    let path = std::fs::canonicalize(profiles).unwrap_or_else(|_| profiles.to_owned());
    Origin { boot: boot.trim().to_owned(), directory: Sum::of(path.as_os_str().as_encoded_bytes()).finish(0) }
}

/// What the run before left; what is refused is told in the log.
fn read(file: &mut File, path: &Path, origin: &Origin) -> Vec<Kept> {
    let mut bytes = Vec::new();
    let told = |reason: &str| tracing::warn!("checkpoints {} are not taken up: {reason}", path.display());
    let len = file.metadata().map(|metadata| metadata.len()).unwrap_or_default();
    if len == 0 {
        return Vec::new();
    }
    if len > CHECKPOINT_FILE_BYTES {
        told("the file is too long");
        return Vec::new();
    }
    if let Err(error) = file.read_to_end(&mut bytes) {
        told(&error.to_string());
        return Vec::new();
    }
    match kept::read(&bytes, origin) {
        Ok((kept, refused)) => {
            refused.iter().for_each(|reason| told(reason));
            kept
        }
        Err(reason) => {
            told(&reason);
            Vec::new()
        }
    }
}

/// Why an instance cannot go on from it.
pub(super) fn reason_against(kept: &Kept, whose: Whose<'_>, regions: &[(&'static str, usize)]) -> Option<String> {
    let same = kept.regions.iter().map(|(name, len)| (name.as_str(), *len)).eq(regions.iter().copied());
    if kept.class != whose.class {
        return Some(format!("it is of class {}, not of {}", kept.class, whose.class));
    }
    if kept.build != whose.build {
        return Some("its plugin is another build".to_owned());
    }
    if !same {
        return Some("its critical regions are others".to_owned());
    }
    if kept.at_ns > clock::now_ns() {
        return Some("it is of a time to come".to_owned());
    }
    (kept.tries >= CHECKPOINT_TRIES)
        .then(|| format!("{} runs went on from it, and none of them came as far as the next one", kept.tries))
}

/// A slot's part of the file.
#[derive(Debug)]
pub struct Room {
    keep: Arc<Keep>,
    mapping: Mapping,
    frame: Frame,
    offset: u64,
}

impl Room {
    /// Says whose it is from now on; there is no copy in it then. False: it does not fit.
    #[must_use]
    pub fn describe(&mut self, whose: Whose<'_>, regions: &[(&'static str, usize)]) -> bool {
        self.frame.describe(self.mapping.bytes_mut(), whose, regions)
    }

    /// Bytes that a copy may have.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.frame.capacity()
    }

    /// A copy.
    #[must_use]
    pub fn copy(&self, index: usize) -> &[u8] {
        &self.mapping.bytes()[self.frame.copy(index)]
    }

    /// A copy, to be written.
    #[must_use]
    pub fn copy_mut(&mut self, index: usize) -> &mut [u8] {
        &mut self.mapping.bytes_mut()[self.frame.copy(index)]
    }

    /// How a copy is to be known; a sum of 0: it is none.
    pub fn stamp(&mut self, index: usize, sum: u64, at_ns: u64) {
        Frame::stamp(self.mapping.bytes_mut(), index, sum, at_ns);
    }

    /// How often it was taken up.
    pub fn count_tries(&mut self, tries: u32) {
        Frame::count_tries(self.mapping.bytes_mut(), tries);
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        let place = (self.offset, self.frame.bytes());
        self.keep.desk().free.push(place);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REGIONS: [(&str, usize); 1] = [("count", 8)];
    const WHOSE: Whose<'_> = Whose { slot: "counter", class: "Counter", build: 1 };

    fn write(keep: &Arc<Keep>, number: u64) -> Room {
        let mut room = keep.room(64, kept::table_of(WHOSE, &REGIONS)).unwrap();
        assert!(room.describe(WHOSE, &REGIONS));
        room.copy_mut(0)[..8].copy_from_slice(&number.to_ne_bytes());
        let at_ns = clock::now_ns();
        let sum = kept::sum_of([8].into_iter(), room.copy(0), at_ns);
        room.stamp(0, sum, at_ns);
        room
    }

    #[test]
    fn what_a_run_left_the_next_one_finds_but_once_it_ended_in_order() {
        let directory = tempfile::tempdir().unwrap();
        let path = beside(&directory.path().join("journal.jsonl"));
        let open = |forget| Keep::open(&path, directory.path(), forget).unwrap();
        let keep = open(false);
        assert!(keep.take(WHOSE, &REGIONS).is_none());
        let room = write(&keep, 7);
        assert!(Keep::open(&path, directory.path(), false).unwrap_err().to_string().contains("another daemon"));
        keep.put_in_place();
        drop((room, keep));
        // A start that came to nothing.
        drop(open(false));
        assert!(open(false).take(Whose { build: 2, ..WHOSE }, &REGIONS).is_none(), "another build");
        let keep = open(false);
        assert_eq!(keep.take(WHOSE, &REGIONS).unwrap().data[..8], 7_u64.to_ne_bytes());
        drop(keep);
        assert!(open(true).take(WHOSE, &REGIONS).is_none(), "it was to be forgotten");
        let keep = open(false);
        keep.put_in_place();
        keep.forget();
        drop(keep);
        assert!(!path.exists() && !new_name(&path).exists());
    }

    #[test]
    fn what_is_taken_up_again_and_again_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("keep");
        let keep = Keep::open(&path, directory.path(), false).unwrap();
        write(&keep, 1).count_tries(CHECKPOINT_TRIES);
        keep.put_in_place();
        drop(keep);
        assert!(Keep::open(&path, directory.path(), false).unwrap().take(WHOSE, &REGIONS).is_none());
    }

    #[test]
    fn a_room_that_was_given_back_is_given_out_again() {
        let directory = tempfile::tempdir().unwrap();
        let keep = Keep::open(&directory.path().join("keep"), directory.path(), false).unwrap();
        let room = |bytes| keep.room(bytes, 100).unwrap();
        let (first, second) = (room(64), room(64));
        let offset = first.offset;
        assert_ne!(offset, second.offset);
        drop(first);
        assert_eq!(room(64).offset, offset);
        assert!(keep.room(usize::try_from(CHECKPOINT_FILE_BYTES).unwrap(), 0).is_err());
    }
}
