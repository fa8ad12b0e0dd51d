//! Sees to it that the file of the emergency stop's latch says what is so, and that its place stays this daemon's. On a thread of
//! its own, because it waits for the disk, and those who depend on a faulty slot do not.

use std::io;
use std::sync::PoisonError;
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, unbounded};
use serde_json::Map;

use super::manager::SharedJournal;
use crate::sys::latch::{self, Cause, Mark, Meddled};
use crate::sys::thread;

/// How long until a file that could not be written is tried again, because somebody may have made room; and until it is read
/// whether it still says what is so.
const AGAIN: Duration = Duration::from_secs(1);

/// The thread, and how it is told.
pub struct Latchkeeper {
    sender: Sender<Option<(Mark, Cause)>>,
    thread: JoinHandle<()>,
}

impl Latchkeeper {
    /// Starts it.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start(journal: SharedJournal) -> io::Result<Self> {
        let (sender, told) = unbounded();
        let thread = thread::spawn("latchkeeper", move || serve(&told, &journal))?;
        Ok(Self { sender, thread })
    }

    /// It was raised; `cause`: what for, once that is known.
    pub fn tell(&self, cause: Option<(Mark, Cause)>) {
        let _ = self.sender.send(cause);
    }

    /// Waits until all is written.
    pub fn finish(self) {
        drop(self.sender);
        let _ = self.thread.join();
    }
}

fn serve(told: &Receiver<Option<(Mark, Cause)>>, journal: &SharedJournal) {
    let (mut before, mut is_held) = (None, true);
    loop {
        let received = told.recv_timeout(AGAIN);
        if received == Err(RecvTimeoutError::Disconnected) {
            return;
        }
        if received.is_err() {
            is_held = hold_place(journal, is_held);
            latch::look_after().into_iter().for_each(|meddled| note(journal, &meddled));
        }
        // Somebody else may have tried meanwhile, in vain.
        look(&mut before);
        match received {
            Ok(cause) => latch::settle(cause),
            Err(_) if before.is_some() => latch::settle(None),
            Err(_) => continue,
        }
        look(&mut before);
    }
}

/// Somebody may have moved or removed the lock, too; told when that changes.
fn hold_place(journal: &SharedJournal, was_held: bool) -> bool {
    let mut journal = journal.lock().unwrap_or_else(PoisonError::into_inner);
    let held = journal.hold_place();
    match &held {
        Err(error) if was_held => tracing::error!("the lock of journal {}: {error}", journal.path().display()),
        Ok(()) if !was_held => tracing::info!("journal {} is this daemon's alone again", journal.path().display()),
        _ => {}
    }
    held.is_ok()
}

/// What somebody did to the file of the latch.
fn note(journal: &SharedJournal, Meddled { file, found }: &Meddled) {
    tracing::warn!("the latch of the emergency stop {}: {found}; it says again what is so", file.display());
    let fields = [("file", file.to_string_lossy().into_owned()), ("found", (*found).to_owned())];
    let fields = fields.map(|(name, text)| (name.to_owned(), text.into()));
    let noted = journal.lock().unwrap_or_else(PoisonError::into_inner).note("latch", Map::from_iter(fields));
    noted.unwrap_or_else(|error| tracing::error!("the journal cannot be written: {error}"));
}

/// Tells what changed.
fn look(before: &mut Option<String>) {
    let now = latch::failure();
    tell(before.as_deref(), now.as_deref());
    *before = now;
}

fn tell(before: Option<&str>, now: Option<&str>) {
    match now {
        Some(now) if before != Some(now) => {
            tracing::error!("an emergency stop would not outlive the daemon: {now}; tried again until it does");
        }
        None if before.is_some() => tracing::info!("an emergency stop outlives the daemon again"),
        _ => {}
    }
}
