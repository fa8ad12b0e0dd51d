//! Sees to it that the file of the emergency stop's latch says what is so. On a thread of its own, because it waits for the disk, and
//! those who depend on a faulty slot do not.

use std::io;
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use crate::sys::latch::{self, Cause};
use crate::sys::thread;

/// How long until a file that could not be written is tried again: somebody may have made room.
const AGAIN: Duration = Duration::from_secs(1);

/// The thread, and how it is told.
pub struct Latchkeeper {
    sender: Sender<Option<Cause>>,
    thread: JoinHandle<()>,
}

impl Latchkeeper {
    /// Starts it.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start() -> io::Result<Self> {
        let (sender, told) = unbounded();
        let thread = thread::spawn("latchkeeper", move || serve(&told))?;
        Ok(Self { sender, thread })
    }

    /// It was raised; `cause`: what for, once that is known.
    pub fn tell(&self, cause: Option<Cause>) {
        let _ = self.sender.send(cause);
    }

    /// Waits until all is written.
    pub fn finish(self) {
        drop(self.sender);
        let _ = self.thread.join();
    }
}

fn serve(told: &Receiver<Option<Cause>>) {
    let mut before = None;
    loop {
        let received = told.recv_timeout(AGAIN);
        if received == Err(RecvTimeoutError::Disconnected) {
            return;
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
