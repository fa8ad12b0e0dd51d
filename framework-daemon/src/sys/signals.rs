//! HUP, TERM, INT and USR1 as values on a channel.

use crossbeam_channel::Receiver;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::iterator::Signals;

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
    let mut signals = Signals::new([SIGHUP, SIGINT, SIGTERM, SIGUSR1])?;
    let (sender, receiver) = crossbeam_channel::unbounded();
    thread::spawn("signals", move || {
        let mut stopping = false;
        for signal in signals.forever() {
            let request = match signal {
                SIGHUP => Request::Reload,
                SIGUSR1 => Request::Status,
                _ => Request::Stop,
            };
            if request == Request::Stop && std::mem::replace(&mut stopping, true) {
                // No word on stderr: whoever does not read it must not be able to stop this. But the motors stop.
                last_words::speak(&Death::LEFT);
                nix::sys::signal::raise(nix::sys::signal::Signal::SIGKILL).ok();
            }
            if sender.send(request).is_err() {
                return;
            }
        }
    })?;
    Ok(receiver)
}
