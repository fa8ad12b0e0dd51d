//! The latch of the emergency stop: one word of the process, and a file beside the journal that outlives it. Whatever ends the
//! daemon, the next one comes up latched, until an operator has looked.
//!
//! The file lies apart from the journal, which may be moved away at any time, and from the checkpoints, which an end in order
//! forgets: an operator who stops the daemon has not said that the robot may move. It says what it was raised for: whoever
//! starts the robot the next morning was not there.
//!
//! Its lock is only tried by the thread that raises: whoever holds it looks at the word again before letting go, or is
//! the fault manager, which is told of the raise and comes back.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use serde_json::{Value, json};

use super::clock;
use super::place::suffixed;

/// The file.
mod file;
/// A link beside that of the journal.
mod link;
/// What it says.
mod record;

use file::Kept;
pub use file::Left;
pub use record::{Cause, Record};

/// When it was latched; 0: it is not.
static LATCH: AtomicU64 = AtomicU64::new(0);
static KEPT: Mutex<Option<Kept>> = Mutex::new(None);
// Held while names are compared or swapped.
static ACTUATORS: Mutex<Vec<&'static str>> = Mutex::new(Vec::new());

/// Where it is kept for a daemon with that journal.
#[must_use]
pub fn beside(journal: &Path) -> PathBuf {
    suffixed(journal, ".emergency")
}

/// The same beside a link to the journal, if `called` is one: it leads to the latch, so that it is found where the journal's link
/// leads elsewhere by the next run.
#[must_use]
pub fn link_beside(called: &Path) -> Option<PathBuf> {
    called.is_symlink().then(|| beside(called))
}

fn kept() -> MutexGuard<'static, Option<Kept>> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Kept {
    /// What fails is told by whoever asks for [`failure`].
    fn say_what_is(&mut self) {
        let _ = self.say(is_set());
        // Raised meanwhile: what that said is gone.
        if is_set() {
            self.shout();
        }
    }
}

/// Keeps the latch in that file from now on, for a run that `own` describes; returns what the run before left. What is latched
/// there, or behind that `link`, is latched, and so is what nobody can read, or what is `missed`; `forget`: it is not, and
/// [`describe`] takes it from the file.
pub fn keep(path: &Path, link: Option<&Path>, own: Record, missed: bool, forget: bool) -> Left {
    let (mut file, left) = Kept::open(path, own, missed);
    let left = match link {
        Some(link) => link::follow(&mut file, link, left),
        None => left,
    };
    *kept() = Some(file);
    if left != Left::Free && !forget {
        let _ = set();
    }
    left
}

/// The file is of that run now, and what was to be forgotten is forgotten: not before it is accepted, or a start that comes to
/// nothing would have forgotten it. While it is latched the file stays that of the run that latched it.
pub fn describe(own: Record) {
    if let Some(kept) = kept().as_mut().filter(|_| !is_set()) {
        kept.record = own;
        kept.say_what_is();
    }
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

/// Sees to it that the next run comes up latched: one write into an open file, no allocation. The fault manager sees to the rest.
pub fn store() {
    if let Ok(kept) = KEPT.try_lock()
        && let Some(kept) = kept.as_ref()
    {
        kept.shout();
    }
}

/// True while it is latched.
#[must_use]
pub fn is_set() -> bool {
    since_ns().is_some()
}

/// When it was latched; `None`: it is not.
#[must_use]
pub fn since_ns() -> Option<u64> {
    Some(LATCH.load(Ordering::SeqCst)).filter(|since_ns| *since_ns != 0)
}

/// It was latched, and is not any more.
#[derive(Clone, Debug, PartialEq)]
pub struct Cleared {
    /// What it had been raised for, as far as that is known.
    pub cause: Option<Cause>,
}

/// Takes it back; `None`: it was not latched.
#[must_use]
pub fn clear() -> Option<Cleared> {
    let mut kept = kept();
    if LATCH.swap(0, Ordering::SeqCst) == 0 {
        return None;
    }
    let cause = kept.as_mut().and_then(|kept| {
        let cause = kept.record.cause.take();
        kept.say_what_is();
        cause
    });
    Some(Cleared { cause })
}

/// Brings the file to what is so, on the disk; `cause`: what it was raised for, once that is known.
pub fn settle(cause: Option<Cause>) {
    if let Some(kept) = kept().as_mut() {
        if is_set() && cause.is_some() {
            kept.record.cause = cause;
        }
        kept.say_what_is();
    }
}

/// Why it would not outlive the daemon; `None`: it would.
#[must_use]
pub fn failure() -> Option<String> {
    let kept = kept();
    let kept = kept.as_ref()?;
    Some(format!("{}: {}", kept.path().display(), kept.failure.as_ref()?))
}

/// For whoever asks how the daemon is.
#[must_use]
pub fn view() -> Value {
    let kept = kept();
    let Some(kept) = kept.as_ref() else { return Value::Null };
    let holds = ACTUATORS.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let mut view = json!({"file": kept.path().to_string_lossy(), "kept": kept.failure.is_none(), "actuators": holds});
    if let Some(failure) = &kept.failure {
        view["failure"] = failure.as_str().into();
    }
    if is_set() {
        view["profiles"] = kept.record.profiles.as_str().into();
        view["cause"] = json!(kept.record.cause);
    }
    view
}
