//! `status`: how all slots of a running daemon are, and the process.

use std::io::{self, Write};

use clap::Args;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::exit_code::Exit;
use super::remote::Remote;
use crate::control::helpers;
use crate::control::views::{cell, status_table};
use crate::sys::latch::{Again, Cause};

const EXAMPLES: &str = "Examples:\n  framework-daemon status\n  \
     framework-daemon status --format json | jq '.slots[] | select(.faults > 0) | .slot'\n\n\
     Of each slot: its state, the class that fills it, and since the start its callbacks, periods that began too late, faults, \
     instances given up, faults after which memory may be damaged; spares that are ready.\n\n\
     Exit codes: 0 answered, 5 no daemon can be reached, 6 refused.";

/// Arguments of `status`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Which daemon, and how it is printed.
    #[command(flatten)]
    pub remote: Remote,
}

/// Asks.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    arguments.remote.ask("Status", Map::new(), out, |status| {
        let head = format!("{}: {}, process {}", cell(&status["directory"]), cell(&status["state"]), status["pid"]);
        let head = if status["emergency"] == true {
            format!("EMERGENCY STOP latched{} (`fault clear` takes it back); {head}", raised_for(&status["latch"]))
        } else {
            head
        };
        let besides = status["latch"]["besides"].as_array().into_iter().flatten();
        let besides = besides.map(|held| format!("held besides: {}: {}", cell(&held["slot"]), cell(&held["reason"])));
        let besides: Vec<String> = besides.collect();
        let holds_nobody = status["emergency"] == true
            && status["latch"]["actuators"].as_array().is_some_and(Vec::is_empty)
            && besides.is_empty();
        let nobody =
            holds_nobody.then(|| "no slot of these profiles is an actuator: the emergency stop holds none".to_owned());
        let unkept = status["latch"]["failure"].as_str();
        let unkept = unkept.map(|why| format!("an emergency stop would not outlive the daemon: {why}"));
        let slots = status["slots"].as_array().map(Vec::as_slice).unwrap_or_default();
        let helpers = status["helpers"].as_array().map(Vec::as_slice).unwrap_or_default();
        let all = std::iter::once(head)
            .chain(nobody)
            .chain(besides)
            .chain(unkept)
            .chain(status_table(slots, &status["process"]));
        all.chain(helpers::lines(helpers)).collect::<Vec<String>>()
    })
}

/// ` for crash.segv of sensor (fault 12, 9 h ago), raised again for crash.panic of arm (fault 14, 3 s ago)`, where that is known.
pub(super) fn raised_for(latch: &Value) -> String {
    let cause = Cause::deserialize(&latch["cause"]).map(|cause| format!(" for {cause}")).unwrap_or_default();
    let again = Again::deserialize(&latch["again"]).map(|again| format!(", {again}")).unwrap_or_default();
    cause + &again
}
