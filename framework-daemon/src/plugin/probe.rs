//! A plugin file that was never loaded is first loaded by a process that may be lost.
//!
//! Loading runs the library's constructors and trusts its tables: a file that an interrupted copy left half-written takes
//! whoever loads it along. In the daemon that would be a robot.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use crate::model::limits::BOOT_STEP;

/// The hidden verb of the command line that loads a plugin and ends.
pub const VERB: &str = "probe";

static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// From now on plugins are probed by `program`, which knows [`VERB`].
pub fn enable(program: PathBuf) {
    let _ = PROGRAM.set(program);
}

/// Loads `file` in another process, if that was enabled.
///
/// # Errors
/// In words, when that process was lost.
pub fn survive(file: &Path) -> Result<(), String> {
    let Some(program) = PROGRAM.get() else { return Ok(()) };
    let child = Command::new(program)
        .arg(VERB)
        .arg(file)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let mut child = child.map_err(|error| format!("it cannot be probed: {error}"))?;
    let began = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) => return judge(status),
            Ok(None) if began.elapsed() < BOOT_STEP => std::thread::sleep(Duration::from_millis(1)),
            Ok(None) => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!("loading it does not return within {BOOT_STEP:?}: its constructors hang"));
            }
            Err(error) => return Err(format!("it cannot be probed: {error}")),
        }
    }
}

/// A process that ended by itself with an exit code of ours lived; what it found is found again, with words, by the daemon.
fn judge(status: ExitStatus) -> Result<(), String> {
    match status.code() {
        Some(0 | 4) => Ok(()),
        _ => Err(format!("loading it ends the process that does it ({status}): build or copy it again")),
    }
}
