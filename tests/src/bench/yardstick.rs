//! A thread that measures a raw limit when asked, scheduled as the thread that it is compared with.

use std::thread::JoinHandle;

use crossbeam_channel::{Receiver, Sender};
use framework_daemon::model::schedule::{Policy, Schedule};
use framework_daemon::sys::thread;

/// Such a thread.
pub struct Yardstick {
    ask: Option<Sender<()>>,
    answers: Receiver<u64>,
    thread: Option<JoinHandle<()>>,
}

/// The schedule of that name: `other`, `fifo`.
#[must_use]
pub fn schedule(policy: &str, priority: i32) -> Schedule {
    let policy = if policy == "fifo" { Policy::Fifo } else { Policy::Other };
    Schedule { policy, priority, cpus: Vec::new() }
}

impl Yardstick {
    /// Starts it.
    ///
    /// # Panics
    /// When there is no thread left.
    #[must_use]
    pub fn start(schedule: Schedule, limit: impl Fn() -> u64 + Send + 'static) -> Self {
        let (ask, asked) = crossbeam_channel::bounded::<()>(1);
        let (answer, answers) = crossbeam_channel::bounded(1);
        let body = move || {
            while asked.recv().is_ok() {
                let _ = answer.send(limit());
            }
        };
        let thread = thread::spawn_guarded("yardstick", schedule, |_| {}, body).expect("a thread");
        Self { ask: Some(ask), answers, thread: Some(thread) }
    }

    /// Nanoseconds of one try.
    ///
    /// # Panics
    /// When the thread is gone.
    #[must_use]
    pub fn measure(&self) -> u64 {
        self.ask.as_ref().expect("open until it is dropped").send(()).expect("the thread waits for it");
        self.answers.recv().expect("the thread answers")
    }
}

impl Drop for Yardstick {
    fn drop(&mut self) {
        self.ask = None;
        let _ = self.thread.take().map(JoinHandle::join);
    }
}
