//! Erlang/OTP's supervisor, where it is installed: an error exit, then the new process answers its first call.

use std::path::Path;
use std::process::{Command, Stdio};

use super::rig::PRIORITY;
use super::stats::Samples;

/// `restarts` of them.
///
/// # Errors
/// In words, when there is no Erlang or no permission.
pub fn measure(policy: &str, restarts: usize) -> Result<Samples, String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/bench/erlang/restart.escript");
    let mut command = if policy == "fifo" {
        let mut command = Command::new("chrt");
        command.args(["-f", &PRIORITY.to_string(), "escript"]);
        command
    } else {
        Command::new("escript")
    };
    let output = command.arg(script).arg(restarts.to_string()).stdin(Stdio::null()).output();
    let output = output.map_err(|error| format!("no Erlang: {error}; its package is erlang-base"))?;
    if !output.status.success() {
        return Err(format!("Erlang failed: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let mut samples = Samples::default();
    String::from_utf8_lossy(&output.stdout).lines().filter_map(|line| line.parse().ok()).for_each(|ns| samples.add(ns));
    Ok(samples)
}
