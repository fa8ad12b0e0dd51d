//! The latch of the emergency stop: one word of the process, and a file beside the journal that outlives it. Whatever ends the
//! daemon, the next one comes up latched, until an operator has looked.
//!
//! The file is opened when the daemon starts, so that a raise costs one write to it; it is empty while nothing is latched.
//! It lies apart from the journal, which may be moved away at any time, and from the checkpoints, which an end in order
//! forgets: an operator who stops the daemon has not said that the robot may move.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};

use super::clock;

/// When it was latched; 0: it is not.
static LATCH: AtomicU64 = AtomicU64::new(0);
static KEPT: OnceLock<File> = OnceLock::new();
// Held while names are compared or swapped.
static ACTUATORS: Mutex<Vec<&'static str>> = Mutex::new(Vec::new());

/// What is in the file, for whoever finds it.
const TEXT: &[u8] = b"the emergency stop is latched: `framework-daemon fault clear` takes it back\n";

/// Where it is kept for a daemon with that journal.
#[must_use]
pub fn beside(journal: &Path) -> PathBuf {
    let mut name = journal.as_os_str().to_owned();
    name.push(".emergency");
    name.into()
}

/// Keeps the latch in that file from now on, once in the life of a process; returns whether the run before left it latched,
/// which it is then. `forget`: whatever that run left.
///
/// # Errors
/// When the file cannot be opened.
pub fn keep(path: &Path, forget: bool) -> io::Result<bool> {
    let file = OpenOptions::new().create(true).truncate(false).read(true).write(true).open(path)?;
    if forget {
        file.set_len(0)?;
    }
    let was_latched = file.metadata()?.len() > 0;
    let _ = KEPT.set(file);
    if was_latched {
        let _ = set();
    }
    Ok(was_latched)
}

/// Who gets the emergency stop from now on.
pub fn guard(actuators: Vec<&'static str>) {
    *ACTUATORS.lock().unwrap_or_else(PoisonError::into_inner) = actuators;
}

/// True for a slot that gets the emergency stop.
#[must_use]
pub fn guards(slot: &str) -> bool {
    ACTUATORS.lock().unwrap_or_else(PoisonError::into_inner).contains(&slot)
}

/// Latches it; true: it was not. What outlives the process is for [`store`] to do, when nothing waits any more.
pub fn set() -> bool {
    LATCH.compare_exchange(0, clock::now_ns(), Ordering::SeqCst, Ordering::SeqCst).is_ok()
}

/// Sees to it that the next run comes up latched: one write into an open file, no allocation.
///
/// # Errors
/// When the file cannot be written.
pub fn store() -> io::Result<()> {
    KEPT.get().map_or(Ok(()), |file| file.write_all_at(TEXT, 0))
}

/// True while it is latched.
#[must_use]
pub fn is_set() -> bool {
    LATCH.load(Ordering::SeqCst) != 0
}

/// Takes it back; false: it was not latched.
///
/// # Errors
/// When the file cannot be written: then the next run comes up latched.
pub fn clear() -> io::Result<bool> {
    let was_latched = LATCH.swap(0, Ordering::SeqCst) != 0;
    if let Some(file) = KEPT.get().filter(|_| was_latched) {
        file.set_len(0)?;
        // Raised again in between: what was written is gone.
        if is_set() {
            store()?;
        }
        file.sync_all()?;
    }
    Ok(was_latched)
}

/// Waits until what [`store`] wrote is on the disk, and writes it where that failed.
///
/// # Errors
/// When the file cannot be written.
pub fn settle() -> io::Result<()> {
    let Some(file) = KEPT.get().filter(|_| is_set()) else { return Ok(()) };
    store()?;
    // Taken back in between: what was written is wrong.
    if !is_set() {
        file.set_len(0)?;
    }
    file.sync_all()
}
