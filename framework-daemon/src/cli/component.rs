//! `component`: the slots of a running daemon, one by one.

use std::io::{self, Write};
use std::time::Duration;

use clap::{Args, Subcommand};
use serde_json::{Map, Value};

use super::exit_code::Exit;
use super::port;
use super::remote::{Remote, fields, parameters, section};
use crate::control::views::{cell, table};
use crate::model::limits::{RESETS_DEFAULT, RESETS_WINDOW};

const EXAMPLES: &str = "Examples:\n  framework-daemon component list\n  framework-daemon component info avoider\n  \
     framework-daemon component reset avoider\n\n\
     Exit codes: 0 answered, 5 no daemon can be reached, 6 refused: no such slot, 7 the emergency stop is latched.";

const LIST_EXAMPLES: &str = "Examples:\n  framework-daemon component list\n  \
     framework-daemon component list --format json | jq -r 'select(.state == \"error\") | .slot'";

const INFO_EXAMPLES: &str = "Examples:\n  framework-daemon component info avoider\n  \
     framework-daemon component info avoider --format json | jq .component.reset";

const ORDER_EXAMPLES: &str = "Examples:\n  framework-daemon component stop camera_a\n  framework-daemon component start camera_a\n  \
     framework-daemon component reset avoider\n\n\
     Exit codes: 0 done, or it waits for what it needs; 5 no daemon can be reached; 6 refused; 7 the emergency stop is latched.";

const COLUMNS: [&str; 9] =
    ["slot", "state", "class", "application", "trigger", "executor", "cycles", "faults", "slots"];

/// What is shown of one slot, in order.
const FIELDS: [&str; 29] = [
    "slot",
    "application",
    "state",
    "reason",
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
    "recovery_last_ns",
    "recovery_worst_ns",
    "recoveries_late",
    "severity",
    "reset",
    "declared",
];

/// What is shown of a voter, in order.
const VOTER: [&str; 13] = [
    "slot",
    "kind",
    "of",
    "field",
    "method",
    "tolerance",
    "require",
    "max_age_ns",
    "severity",
    "votes",
    "agreeing",
    "outvoted",
    "falls_short",
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
    /// Have a slot run; one that lacks what it needs runs as soon as that works.
    #[command(after_help = ORDER_EXAMPLES)]
    Start(Order),
    /// Have a slot not run; those that need it stop first.
    #[command(after_help = ORDER_EXAMPLES)]
    Stop(Order),
    /// Have a slot run again that a fault stopped.
    #[command(after_help = ORDER_EXAMPLES)]
    Reset(Order),
    /// Show all of one slot: counters, ports, properties, fault rules; or of a composite: its slots, the ports that it shows;
    /// or of a voter: who votes, and how the last vote ended.
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

/// Arguments of `component start`, `stop` and `reset`.
#[derive(Debug, Args)]
pub struct Order {
    /// The slot.
    #[arg(value_name = "SLOT")]
    pub slot: String,
    /// Which daemon, and how it is printed.
    #[command(flatten)]
    pub remote: Remote,
}

impl Order {
    fn give(&self, method: &str, out: &mut impl Write) -> io::Result<Exit> {
        let asked = parameters([("slot", Some(self.slot.as_str().into()))]);
        self.remote.ask_patiently(method, asked, out, |answer| vec![ordered(answer)])
    }
}

/// `planner: inactive, needs 1 of camera_a camera_b`.
pub(super) fn ordered(answer: &Value) -> String {
    let reason = answer["reason"].as_str().map(|reason| format!(", {reason}")).unwrap_or_default();
    format!("{}: {}{reason}", cell(&answer["slot"]), cell(&answer["state"]))
}

/// Asks.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    match &arguments.verb {
        Verb::List { remote } => remote.list("ListComponents", Map::new(), "components", out, components),
        Verb::Start(order) => order.give("StartComponent", out),
        Verb::Stop(order) => order.give("StopComponent", out),
        Verb::Reset(order) => order.give("ResetComponent", out),
        Verb::Info { slot, remote } => {
            let asked = parameters([("slot", Some(slot.as_str().into()))]);
            remote.ask("DescribeComponent", asked, out, |answer| describe(&answer["component"]))
        }
    }
}

/// Composites, where there are any, tell the slots in them.
fn components(rows: &[Value]) -> Vec<String> {
    let has_composites = rows.iter().any(is_composite);
    table(&COLUMNS[..COLUMNS.len() - usize::from(!has_composites)], rows)
}

fn is_composite(component: &Value) -> bool {
    !component["slots"].is_null()
}

fn describe(component: &Value) -> Vec<String> {
    if is_composite(component) {
        let ports = component["ports"].as_array().cloned().unwrap_or_default();
        let shown = section("ports", &["port", "is", "direction", "type", "connections"], &ports);
        return [fields(component, &COLUMNS), shown].concat();
    }
    let rows = |name: &str| component[name].as_array().cloned().unwrap_or_default();
    if component["kind"] == "voter" {
        return [fields(component, &VOTER), section("ports", &["port", "type", "connections"], &rows("ports"))]
            .concat();
    }
    let mut shown = component.clone();
    shown["severity"] = severity(&component["severity"]).into();
    shown["reset"] = intensity(&component["reset"]).into();
    let mut lines = fields(&shown, &FIELDS);
    lines.extend(section("lost devices", &["device", "lost_ns"], &rows("lost_devices")));
    lines.extend(section("properties", &["name", "type", "value"], &rows("properties")));
    lines.extend(section("secondaries", &["class", "preload"], &rows("secondaries")));
    lines.extend(section("tasks", &["task", "runs", "count"], &rows("tasks")));
    let mut ports = rows("ports");
    ports.iter_mut().for_each(|row| row["port"] = port::name(row).into());
    lines.extend(section("ports", &["port", "direction", "type", "connections"], &ports));
    lines
}

/// What most symptoms are answered by, then the others: `reset; hang: stop`.
fn severity(table: &Value) -> String {
    let answers: Vec<(String, String)> =
        table.as_object().into_iter().flatten().map(|(symptom, answer)| (symptom.clone(), cell(answer))).collect();
    let count = |answer: &str| answers.iter().filter(|(_, other)| other == answer).count();
    let Some((_, most)) = answers.iter().max_by_key(|(_, answer)| count(answer)) else { return String::new() };
    let others = answers.iter().filter(|(_, answer)| answer != most);
    let others = others.map(|(symptom, answer)| format!("; {symptom}: {answer}"));
    std::iter::once(most.clone()).chain(others).collect()
}

/// `at most 3 in 10s`.
fn intensity(reset: &Value) -> String {
    let time = |ns: u64| format!("{:?}", Duration::from_nanos(ns));
    match (reset["limit"].as_u64(), reset["within_ns"].as_u64()) {
        (Some(limit), Some(within_ns)) => format!("at most {limit} in {}", time(within_ns)),
        _ => format!("at most {RESETS_DEFAULT} in {RESETS_WINDOW:?}, as nothing is said"),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn rules_are_told_in_few_words() {
        let table = json!({"crash.segv": "reset", "error": "reset", "hang": "stop"});
        assert_eq!(severity(&table), "reset; hang: stop");
        assert_eq!(intensity(&json!({"limit": 3, "within_ns": 10_000_000_000_u64})), "at most 3 in 10s");
        assert!(intensity(&Value::Null).starts_with("at most 10 in 10s"));
    }
}
