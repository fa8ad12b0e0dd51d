//! `sys::futex` for the checker: compares and waits in one step, wakes one waiter, and never by itself, so that a wake-up that
//! is lost is a deadlock that the checker reports.

pub use loom::sync::atomic::{AtomicPtr, AtomicU32, Ordering, fence};
use loom::sync::{Condvar, Mutex};

struct Queue {
    lock: Mutex<()>,
    changed: Condvar,
}

loom::lazy_static! {
    static ref QUEUE: Queue = Queue { lock: Mutex::new(()), changed: Condvar::new() };
}

/// Waits while `word` holds `seen`, until woken.
///
/// # Panics
/// Never: no thread panics with the lock.
pub fn wait(word: &AtomicU32, seen: u32, _deadline_ns: Option<u64>) {
    let guard = QUEUE.lock.lock().expect("no thread panics with the lock");
    if word.load(Ordering::Relaxed) == seen {
        drop(QUEUE.changed.wait(guard));
    }
}

/// Wakes one thread that waits.
///
/// # Panics
/// Never: no thread panics with the lock.
pub fn wake_one(_word: &AtomicU32) {
    let _guard = QUEUE.lock.lock().expect("no thread panics with the lock");
    QUEUE.changed.notify_one();
}

/// Lets other threads go on.
pub fn pause() {
    loom::thread::yield_now();
}
