//! `reload`: a running daemon reads its profiles again.

use std::io::{self, Write};

use clap::Args;
use serde_json::Map;

use super::exit_code::Exit;
use super::remote::Remote;
use crate::control::views::cell;
use crate::supervise::reload::Changes;

const EXAMPLES: &str = "Examples:\n  framework-daemon reload\n  framework-daemon reload --format json | jq .changed\n\n\
     All or nothing: what is wrong with the new profiles is printed as `check` does, and everything runs on as it was.\n\n\
     Exit codes: 0 reloaded, 5 no daemon can be reached, 6 refused, 7 the emergency stop is latched.";

/// Arguments of `reload`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Which daemon, and how it is printed.
    #[command(flatten)]
    pub remote: Remote,
}

/// Orders it and waits for the end.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    arguments.remote.ask_patiently("Reload", Map::new(), out, |answer| {
        let names = |field: &str| answer[field].as_array().into_iter().flatten().map(cell).collect();
        let kept = answer["kept"].as_u64().and_then(|kept| usize::try_from(kept).ok()).unwrap_or_default();
        let (added, removed, changed) = (names("added"), names("removed"), names("changed"));
        let changes = Changes { added, removed, changed, kept, taken_up: names("taken_up") };
        vec![changes.to_string()]
    })
}
