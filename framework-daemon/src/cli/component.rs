//! `component`: the slots of a running daemon, one by one.

use std::io::{self, Write};

use clap::{Args, Subcommand};
use serde_json::{Map, Value};

use super::exit_code::Exit;
use super::remote::{Remote, fields, parameters, section};
use crate::control::views::table;

const EXAMPLES: &str = "Examples:\n  framework-daemon component list\n  framework-daemon component info avoider\n\n\
     Exit codes: 0 answered, 5 no daemon can be reached, 6 refused: no such slot.";

const LIST_EXAMPLES: &str = "Examples:\n  framework-daemon component list\n  \
     framework-daemon component list --format json | jq -r 'select(.state == \"error\") | .slot'";

const INFO_EXAMPLES: &str = "Examples:\n  framework-daemon component info avoider\n  \
     framework-daemon component info avoider --format json | jq .component.reset";

const COLUMNS: [&str; 8] = ["slot", "state", "class", "application", "trigger", "executor", "cycles", "faults"];

/// What is shown of one slot, in order.
const FIELDS: [&str; 25] = [
    "slot",
    "application",
    "state",
    "class",
    "primary",
    "version",
    "library",
    "trigger",
    "executor",
    "autostart",
    "deadline_ns",
    "stack_bytes",
    "cycles",
    "missed",
    "longest_ns",
    "faults",
    "quarantined",
    "tainted",
    "spares",
    "spares_wanted",
    "checkpoint_ns",
    "recovery_within_ns",
    "severity",
    "reset",
    "declared",
];

/// Arguments of `component`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// What about them.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What about components.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// List all slots: state, class, what triggers them.
    #[command(after_help = LIST_EXAMPLES)]
    List {
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
    /// Show all of one slot: counters, ports, properties, fault rules.
    #[command(after_help = INFO_EXAMPLES)]
    Info {
        /// The slot.
        #[arg(value_name = "SLOT")]
        slot: String,
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
}

/// Asks.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    match &arguments.verb {
        Verb::List { remote } => {
            remote.list("ListComponents", Map::new(), "components", out, |rows| table(&COLUMNS, rows))
        }
        Verb::Info { slot, remote } => {
            let asked = parameters([("slot", Some(slot.as_str().into()))]);
            remote.ask("DescribeComponent", asked, out, |answer| describe(&answer["component"]))
        }
    }
}

fn describe(component: &Value) -> Vec<String> {
    let rows = |name: &str| component[name].as_array().cloned().unwrap_or_default();
    let mut lines = fields(component, &FIELDS);
    lines.extend(section("properties", &["name", "type", "value"], &rows("properties")));
    lines.extend(section("secondaries", &["class", "preload"], &rows("secondaries")));
    lines.extend(section("ports", &["port", "direction", "type", "connections"], &rows("ports")));
    lines
}
