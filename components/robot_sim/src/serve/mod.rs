//! The simulation played to the outside: pseudo-terminal, camera socket, record of the truth, real time.
//!
//! clock → [`Player`] → [`pty`] in → simulation → [`pty`] out, [`camera_socket`], [`record`]

pub mod camera_socket;
mod player;
pub mod pty;
pub mod record;

use std::io;
use std::path::Path;

use thiserror::Error;

pub use player::{Ending, Player, Playing};

/// Something outside the simulation that failed.
#[derive(Debug, Error)]
pub enum ServeError {
    /// The system refused an operation.
    #[error("cannot {doing} {path}: {source}")]
    System {
        /// What was being done.
        doing: &'static str,
        /// To what.
        path: String,
        /// The system's answer.
        source: io::Error,
    },
    /// A place is taken by something that is not ours to remove.
    #[error("{path} exists and is {what}; remove it or choose another path")]
    Taken {
        /// The place.
        path: String,
        /// What stands there.
        what: &'static str,
    },
}

impl ServeError {
    pub(crate) fn system(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.display().to_string();
        move |source| Self::System { doing, path, source }
    }
}

/// Nanoseconds of the system's monotonic clock, the one the daemon's journal uses too.
#[must_use]
pub fn mono_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    // Never negative: the clock counts from the system's start.
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}
