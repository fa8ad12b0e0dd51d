//! The demo: the daemon drives the simulated robot while its components are made to fail.
//!
//! arguments → [`profile`] copy → [`process`]es → [`follow`] record and journal → [`progress`] → [`report`] → [`table`], [`svg`]
//!
//! Decision: the demo is a client of files and processes only, as a user is. Linking the daemon in and
//! reading its tables is less work, but would show what the daemon believes, not what it leaves behind.

pub mod compare;
pub mod follow;
pub mod journal;
pub mod process;
pub mod profile;
pub mod progress;
pub mod report;
pub mod run;
pub mod schedule;
pub mod steering;
pub mod svg;
pub mod table;
mod watch;

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why a demo could not be carried through. (A robot that does not arrive is a report, not an error.)
#[derive(Debug, Error)]
pub enum DemoError {
    /// The system refused an operation.
    #[error("cannot {doing} {path}: {source}")]
    System {
        /// What was being done.
        doing: &'static str,
        /// To what.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
    /// A program that the demo needs is not there.
    #[error("{0} is not there; build it first (scripts/demo does) or name another with --daemon")]
    Missing(PathBuf),
    /// A program did not get ready.
    #[error("{program} {what}; its last words:\n{words}")]
    NotReady {
        /// Which.
        program: &'static str,
        /// What it did instead.
        what: String,
        /// The end of its log.
        words: String,
    },
    /// The profile does not have what the demo has to set.
    #[error("no XML file in {directory} has {wanted}; the demo needs it to connect the profile to the simulator")]
    Profile {
        /// Where it looked.
        directory: PathBuf,
        /// What it looked for.
        wanted: String,
    },
    /// Ended by a signal.
    #[error("interrupted; everything that was started has been ended")]
    Interrupted,
}

impl DemoError {
    pub(crate) fn system(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::System { doing, path, source }
    }
}
