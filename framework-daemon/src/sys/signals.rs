//! HUP, TERM, INT and USR1 as values on a channel.
//!
//! Handlers wake the thread that listens through a pair of sockets. `signal-hook`'s own way to wait reads from it, and panics
//! where that does not wait or fails: what a component may do to any descriptor. So the wait is ours, and its
//! result does not matter: which signals came is known without the sockets.

use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::time::Duration;

use crossbeam_channel::Receiver;
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::iterator::backend::SignalDelivery;
use signal_hook::iterator::exfiltrator::SignalOnly;

use super::last_words::{self, Death};
use super::thread;

/// What a signal asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// SIGHUP: read the profiles again.
    Reload,
    /// SIGTERM or the first SIGINT: end in order.
    Stop,
    /// SIGUSR1: tell how everything is.
    Status,
}

/// Listens from now on. A second SIGINT or SIGTERM leaves at once, whatever the daemon does.
///
/// # Errors
/// When the handlers cannot be installed.
pub fn listen() -> std::io::Result<Receiver<Request>> {
    let (read, write) = UnixStream::pair()?;
    let heard = [SIGHUP, SIGINT, SIGTERM, SIGUSR1];
    let mut signals = SignalDelivery::with_pipe(read, write, SignalOnly, heard)?;
    let (sender, receiver) = crossbeam_channel::unbounded();
    thread::spawn("signals", move || {
        let mut stopping = false;
        loop {
            wait(signals.get_read());
            for signal in signals.pending() {
                let request = request(signal);
                if request == Request::Stop && std::mem::replace(&mut stopping, true) {
                    leave();
                }
                if sender.send(request).is_err() {
                    return;
                }
            }
        }
    })?;
    Ok(receiver)
}

/// How often is looked where nothing wakes any more.
const PATIENCE: u16 = 1_000;

/// Where nothing can be waited for.
const PAUSE: Duration = Duration::from_millis(100);

/// Until a signal came, or may have.
fn wait(pipe: &UnixStream) {
    let mut waited = [PollFd::new(pipe.as_fd(), PollFlags::POLLIN)];
    let result = poll(&mut waited, PollTimeout::from(PATIENCE));
    let is_broken = waited[0].revents().is_none_or(|seen| !PollFlags::POLLIN.contains(seen));
    if result != Err(Errno::EINTR) && is_broken {
        std::thread::sleep(PAUSE);
    }
}

fn request(signal: i32) -> Request {
    match signal {
        SIGHUP => Request::Reload,
        SIGUSR1 => Request::Status,
        _ => Request::Stop,
    }
}

/// No word on stderr: whoever does not read it must not be able to stop this. But the motors stop.
fn leave() {
    last_words::speak(&Death::LEFT);
    nix::sys::signal::raise(nix::sys::signal::Signal::SIGKILL).ok();
}
