//! What nobody's callback would notice, silence: one thread looks for it, at monitors and at voters, each when it can have
//! become too long.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::sys::{clock, thread};

/// Looks at something at that time; returns when to look next.
pub type Look = Box<dyn FnMut(u64) -> u64 + Send>;

/// The thread, which ends with this.
pub struct Watch {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    looks: Mutex<Vec<(u64, Look)>>,
    over: Mutex<bool>,
    ended: Condvar,
}

impl Watch {
    /// Looks at all of these from now on; `None`: there are none.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start(looks: Vec<Look>) -> std::io::Result<Option<Self>> {
        if looks.is_empty() {
            return Ok(None);
        }
        let looks = Mutex::new(looks.into_iter().map(|look| (0, look)).collect());
        let shared = Arc::new(Shared { looks, over: Mutex::new(false), ended: Condvar::new() });
        let own = Arc::clone(&shared);
        let thread = thread::spawn("monitors", move || {
            // The emergency stop may follow from what it finds.
            thread::hurry();
            own.run();
        })?;
        Ok(Some(Self { shared, thread: Some(thread) }))
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        *lock(&self.shared.over) = true;
        self.shared.ended.notify_all();
        // It ends at once: it holds nothing that others wait for.
        self.thread.take().into_iter().for_each(|thread| _ = thread.join());
    }
}

impl Shared {
    fn run(&self) {
        loop {
            let due_ns = self.look();
            let over = lock(&self.over);
            if *over {
                return;
            }
            let pause = Duration::from_nanos(due_ns.saturating_sub(clock::now_ns()));
            let waited = self.ended.wait_timeout_while(over, pause, |over| !*over);
            drop(waited.unwrap_or_else(PoisonError::into_inner));
        }
    }

    /// Looks at those whose time has come; when to look next.
    fn look(&self) -> u64 {
        let mut looks = lock(&self.looks);
        for (due_ns, look) in looks.iter_mut() {
            let now_ns = clock::now_ns();
            if *due_ns <= now_ns {
                *due_ns = look(now_ns);
            }
        }
        looks.iter().map(|(due_ns, _)| *due_ns).min().unwrap_or(u64::MAX)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
