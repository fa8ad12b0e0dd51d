//! The latch of the emergency stop: one word of the process, and a file beside the journal that outlives it. Whatever ends the
//! daemon, the next one comes up latched, until an operator has looked.
//!
//! The file lies apart from the journal, which may be moved away at any time, and from the checkpoints, which an end in order
//! forgets: an operator who stops the daemon has not said that the robot may move. It says what it was raised for: whoever
//! starts the robot the next morning was not there.
//!
//! A word in memory beside it says so before anybody is told, for a process that is killed in the middle of a raise.
//!
//! Its lock is only tried by the thread that raises: whoever holds it looks at the word again before letting go, or is
//! the fault manager, which is told of the raise and comes back.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use serde::Serialize;
use serde_json::{Value, json};

use super::clock;
use super::place::suffixed;

/// A word in memory beside it.
mod companion;
/// The file.
mod file;
/// A link beside that of the journal.
mod link;
/// What it says.
mod record;

use companion::Companion;
use file::Kept;
pub use file::Left;
pub use record::{Again, Cause, Record};

/// A [`Mark`]; 0: it is not latched.
static LATCH: AtomicU64 = AtomicU64::new(0);
/// Once in the life of a process.
static COMPANION: OnceLock<Companion> = OnceLock::new();
static KEPT: Mutex<Option<Kept>> = Mutex::new(None);
/// Who is held besides, until it is cleared.
static BESIDES: Mutex<Vec<Besides>> = Mutex::new(Vec::new());
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

/// When it was latched, by which run, and how often it was raised by then: who clears it clears no raise that came after that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark(u64);

impl Mark {
    /// Bits below the time.
    const BITS: u32 = 16;
    /// The run before left it latched.
    const LEFT: u64 = 1 << (Self::BITS - 1);
    /// The largest count, more than there are slots; it goes no further.
    const MOST: u64 = Self::LEFT - 1;

    /// Latched at that time and raised so often; kept in microseconds, for which the other bits last nine years of uptime.
    #[must_use]
    pub const fn new(now_ns: u64, raises: u64) -> Self {
        let now_us = now_ns / 1_000;
        Self((if now_us == 0 { 1 } else { now_us }) << Self::BITS | raises)
    }

    /// Found latched at that time.
    #[must_use]
    pub const fn left(now_ns: u64) -> Self {
        Self::new(now_ns, Self::LEFT)
    }

    /// When it was latched (monotonic, microseconds): of one latch, as long as that lasts.
    #[must_use]
    pub const fn since_us(self) -> u64 {
        self.0 >> Self::BITS
    }

    /// How often it was raised in this run since it is latched.
    #[must_use]
    pub const fn raises(self) -> u64 {
        self.0 & Self::MOST
    }

    /// True where its first raise in this run found it unlatched, and is the only one.
    #[must_use]
    pub const fn is_first(self) -> bool {
        self.raises() == 1 && self.0 & Self::LEFT == 0
    }

    /// Raised once more.
    #[must_use]
    pub const fn again(self) -> Self {
        Self(if self.raises() == Self::MOST { self.0 } else { self.0 + 1 })
    }
}

fn kept() -> MutexGuard<'static, Option<Kept>> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Kept {
    /// What fails is told by whoever asks for [`failure`].
    fn say_what_is(&mut self) {
        let latched = is_set();
        let _ = self.say(latched);
        // After the disk: a kill between the two leaves it latched.
        COMPANION.get().into_iter().for_each(|companion| companion.say(latched));
        // Raised meanwhile: what that said is gone.
        if is_set() {
            shout_in_memory();
            self.shout();
        }
    }
}

/// It is about to be raised: one store, so that no kill comes in between that the next run does not hear of.
pub fn foretell() {
    shout_in_memory();
}

fn shout_in_memory() {
    COMPANION.get().into_iter().for_each(|companion| companion.say(true));
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
    let left = match left {
        Left::Free if Companion::peek(path) => {
            file.record = file.before.clone();
            // On the disk before the word is made anew.
            let _ = file.say(true);
            Left::Latched(file.record.clone())
        }
        left => left,
    };
    match Companion::make(path, left != Left::Free) {
        Ok(companion) => _ = COMPANION.set(companion),
        Err(error) => tracing::info!("the latch of the emergency stop has no companion in memory: {error}"),
    }
    *kept() = Some(file);
    if left != Left::Free && !forget {
        restore();
    }
    left
}

/// The file is of that run now, and what was to be forgotten is forgotten: not before it is accepted, or a start that comes to
/// nothing would have forgotten it. While it is latched the file stays that of the run that latched it.
pub fn describe(own: Record) {
    if let Some(kept) = kept().as_mut() {
        kept.own = own;
        if !is_set() {
            kept.record = kept.own.clone();
            kept.say_what_is();
        }
    }
}

/// A slot that the latch holds although the profiles do not say so.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Besides {
    /// Its name.
    pub slot: String,
    /// In words.
    pub reason: String,
}

/// The latch that the run before left holds these, too, until it is cleared.
pub fn hold_besides(slots: Vec<Besides>) {
    *besides_now() = slots;
}

fn besides_now() -> MutexGuard<'static, Vec<Besides>> {
    BESIDES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Whom it holds besides the actuators of the profiles, and why.
#[must_use]
pub fn besides() -> Vec<Besides> {
    besides_now().clone()
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

/// Latches it, as the run before left it.
fn restore() {
    let mark = Mark::left(clock::now_ns());
    let _ = LATCH.compare_exchange(0, mark.0, Ordering::SeqCst, Ordering::SeqCst);
}

/// Latches it; true: it was not. What outlives the process is for [`store`] to do, when nothing waits any more.
pub fn set() -> (Mark, bool) {
    let now_ns = clock::now_ns();
    let raised = |word| if word == 0 { Mark::new(now_ns, 1) } else { Mark(word).again() };
    let mut before = LATCH.load(Ordering::SeqCst);
    loop {
        let mark = raised(before);
        match LATCH.compare_exchange_weak(before, mark.0, Ordering::SeqCst, Ordering::SeqCst) {
            Ok(_) => {
                shout_in_memory();
                return (mark, before == 0);
            }
            Err(other) => before = other,
        }
    }
}

/// Sees to it that the next run comes up latched: one write into an open file, no allocation. The fault manager sees to the rest.
pub fn store() {
    if let Ok(kept) = KEPT.try_lock()
        && let Some(kept) = kept.as_ref()
    {
        kept.shout();
    }
}

/// An end in order leaves nothing in memory but a latch that is latched.
pub fn finish() {
    let _kept = kept();
    if !is_set() {
        COMPANION.get().into_iter().for_each(Companion::remove);
    }
}

/// True while it is latched.
#[must_use]
pub fn is_set() -> bool {
    mark().is_some()
}

/// Since when it is latched, and how often it was raised; `None`: it is not.
#[must_use]
pub fn mark() -> Option<Mark> {
    Some(LATCH.load(Ordering::SeqCst)).filter(|word| *word != 0).map(Mark)
}

/// It was latched, and is not any more.
#[derive(Clone, Debug, PartialEq)]
pub struct Cleared {
    /// What it had been raised for, as far as that is known.
    pub cause: Option<Cause>,
    /// What it had been raised for after that.
    pub again: Option<Again>,
}

/// Takes it back as it was then; `None`: it is not latched, or was raised once more since.
#[must_use]
pub fn clear(then: Mark) -> Option<Cleared> {
    let mut kept = kept();
    LATCH.compare_exchange(then.0, 0, Ordering::SeqCst, Ordering::SeqCst).ok()?;
    besides_now().clear();
    let mut cleared = Cleared { cause: None, again: None };
    if let Some(kept) = kept.as_mut() {
        let record = &mut kept.record;
        cleared = Cleared { cause: record.cause.take(), again: record.again.take() };
        kept.record = kept.own.clone();
        kept.say_what_is();
    }
    Some(cleared)
}

/// Brings the file to what is so, on the disk; `cause`: what that latch was raised for, once that is known.
pub fn settle(cause: Option<(Mark, Cause)>) {
    if let Some(kept) = kept().as_mut() {
        let is_of_now = |then: &Mark| mark().is_some_and(|now| now.since_us() == then.since_us());
        if let Some((_, cause)) = cause.filter(|(then, _)| is_of_now(then)) {
            kept.record.raised_for(cause);
        }
        kept.say_what_is();
    }
}

/// Sees to it that the file still says what is so; returns what somebody did to it. As somebody may restore an old copy at any
/// time, or cut it short, it is read for that.
pub fn look_after() -> Option<Meddled> {
    let mut kept = kept();
    let kept = kept.as_mut()?;
    let before = mark();
    // Raised meanwhile it says so by now, and is brought to the disk by who is told of that.
    let found = kept.meddled(before.is_some()).filter(|_| mark() == before)?;
    kept.say_what_is();
    Some(Meddled { file: kept.path().to_owned(), found })
}

/// What somebody did to the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Meddled {
    /// Where it is.
    pub file: PathBuf,
    /// In words.
    pub found: &'static str,
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
        view["again"] = json!(kept.record.again);
        view["besides"] = json!(besides());
    }
    view
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mark_tells_one_latch_and_one_raise_from_another() {
        let first = Mark::new(5_000_000, 1);
        assert_eq!((first.since_us(), first.raises()), (5_000, 1));
        assert_eq!((first.again().since_us(), first.again().raises()), (5_000, 2));
        assert_ne!(Mark::new(0, 0).0, 0, "latched at the very beginning");
        let many = Mark::new(5_000_000, Mark::MOST);
        assert_eq!(many.again(), many);
        let left = Mark::left(5_000_000);
        assert_eq!((left.raises(), left.again().raises(), left.since_us()), (0, 1, 5_000));
        assert!(first.is_first() && !first.again().is_first() && !left.is_first() && !left.again().is_first());
    }
}
