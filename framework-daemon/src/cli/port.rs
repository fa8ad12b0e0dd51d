//! `port`: the ports of a running daemon's slots.

use std::io::{self, Write};
use std::time::Duration;

use clap::{Args, Subcommand};
use serde_json::Value;

use super::exit_code::Exit;
use super::remote::{Remote, fields, parameters, port_name};
use crate::control::views::{cell, table};
use crate::model::limits::{RATE_WINDOW_MAX, RATE_WINDOW_MIN};

const EXAMPLES: &str = "Examples:\n  framework-daemon port list avoider\n  framework-daemon port info motors.command\n  \
     framework-daemon port hz sonar.ranges\n  framework-daemon port echo motors.command\n\n\
     Exit codes: 0 answered, 5 no daemon can be reached, 6 refused: no such slot or port.";

const LIST_EXAMPLES: &str = "Examples:\n  framework-daemon port list\n  framework-daemon port list avoider\n  \
     framework-daemon port list --format json | jq -r 'select(.connections == []) | .slot + \".\" + .port'";

const INFO_EXAMPLES: &str = "Examples:\n  framework-daemon port info motors.command\n  \
     framework-daemon port info motors.command --format json | jq .layout";

const HZ_EXAMPLES: &str = "Examples:\n  framework-daemon port hz sonar.ranges\n  \
     framework-daemon port hz sonar.ranges --window 0.2 --count 5 --format json\n\n\
     Values are counted where they arrive: an output is measured at one of its readers, or by the voter or model \
     that hears it; the answer names it.";

const ECHO_EXAMPLES: &str = "Examples:\n  framework-daemon port echo sonar.ranges\n  \
     framework-daemon port echo motors.command --count 1 --format json | jq .echo.value\n\n\
     A reader like the others: what comes faster than it is looked at is passed over, and its number told. Of an input the \
     values are shown that its writers send.";

const COLUMNS: [&str; 8] = ["port", "direction", "type", "policy", "received", "dropped", "waiting", "connections"];

/// Arguments of `port`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// What about them.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What about ports.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// List ports: what they carry, who is at the other end, what came and was lost.
    #[command(after_help = LIST_EXAMPLES)]
    List {
        /// Only those of this slot.
        #[arg(value_name = "SLOT")]
        slot: Option<String>,
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
    /// Show all of one port, with the layout of what it carries.
    #[command(after_help = INFO_EXAMPLES)]
    Info {
        /// The port.
        #[arg(value_name = "SLOT.PORT", value_parser = port_name)]
        port: (String, String),
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
    /// Measure how many values a second a port carries, until told to stop.
    #[command(after_help = HZ_EXAMPLES)]
    Hz {
        /// The port.
        #[arg(value_name = "SLOT.PORT", value_parser = port_name)]
        port: (String, String),
        /// Time over which is measured, in seconds.
        #[arg(long, value_name = "SECONDS", default_value = "1", value_parser = window)]
        window: Duration,
        /// End after that many measurements.
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
        count: Option<u64>,
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
    /// Show the values that pass a port, until told to stop.
    #[command(after_help = ECHO_EXAMPLES)]
    Echo {
        /// The port.
        #[arg(value_name = "SLOT.PORT", value_parser = port_name)]
        port: (String, String),
        /// End after that many values.
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
        count: Option<u64>,
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
    let named = |(slot, port): &(String, String), window: Option<Duration>| {
        let window = window.and_then(|window| u64::try_from(window.as_millis()).ok()).map(Value::from);
        let (slot, port) = (slot.as_str().into(), port.as_str().into());
        parameters([("slot", Some(slot)), ("port", Some(port)), ("window_ms", window)])
    };
    match &arguments.verb {
        Verb::List { slot, remote } => {
            let asked = parameters([("slot", slot.as_deref().map(Value::from))]);
            remote.list("ListPorts", asked, "ports", out, ports)
        }
        Verb::Info { port, remote } => remote.ask("DescribePort", named(port, None), out, describe),
        Verb::Hz { port, window, count, remote } => {
            remote.follow("Hz", named(port, Some(*window)), *count, out, |answer| rate(&answer["rate"]))
        }
        Verb::Echo { port, count, remote } => {
            remote.follow("Echo", named(port, None), *count, out, |answer| echo(&answer["echo"]))
        }
    }
}

fn ports(rows: &[Value]) -> Vec<String> {
    let full = |row: &Value| {
        let mut row = row.clone();
        row["port"] = format!("{}.{}", cell(&row["slot"]), name(&row)).into();
        row
    };
    table(&COLUMNS, &rows.iter().map(full).collect::<Vec<_>>())
}

/// A port's name, and the one by which others find it.
pub(super) fn name(port: &Value) -> String {
    match (cell(&port["port"]), port["known_as"].as_str()) {
        (own, None) => own,
        (own, Some("")) => format!("{own} (unlisted)"),
        (own, Some(known)) => format!("{own} (known as {known})"),
    }
}

fn describe(answer: &Value) -> Vec<String> {
    let names = [
        "slot",
        "port",
        "known_as",
        "is",
        "direction",
        "type",
        "connections",
        "heard_by",
        "voters",
        "votes",
        "policy",
        "received",
        "dropped",
        "waiting",
        "asked",
        "failed",
        "in_hand",
        "refused",
        "every",
        "period_ns",
        "running",
        "missed",
        "min_cycle_ns",
        "early",
        "max_age_ns",
        "monitors",
        "activations",
        "activations_max",
        "handled",
        "fired",
    ];
    // Each kind of port counts something else.
    let told: Vec<&str> = names.into_iter().filter(|name| !answer["port"][*name].is_null()).collect();
    let mut lines = fields(&answer["port"], &told);
    let carried = &answer["layout"];
    let parts = ["request", "answer", "parameter", "event"].into_iter().filter(|part| carried.get(part).is_some());
    let parts: Vec<(&str, &Value)> = parts.map(|part| (part, &carried[part])).collect();
    for (heading, object) in if parts.is_empty() { vec![("layout", carried)] } else { parts } {
        lines.push(heading.to_owned());
        layout(object, "", &mut lines);
    }
    lines
}

/// A line for each field, indented by its depth.
fn layout(object: &Value, indent: &str, lines: &mut Vec<String>) {
    let indent = format!("{indent}  ");
    for field in object["fields"].as_array().into_iter().flatten() {
        let kind = &field["type"];
        let count = kind["count"].as_u64().map(|count| format!(", {count} of them")).unwrap_or_default();
        lines.push(format!("{indent}{}: {}{count}", cell(&field["name"]), cell(&kind["name"])));
        layout(kind, &indent, lines);
    }
    if let Some(element) = object.get("element") {
        lines.push(format!("{indent}each: {}", cell(&element["name"])));
        layout(element, &indent, lines);
    }
}

fn rate(rate: &Value) -> String {
    let (hz, seconds) = (rate["hz"].as_f64().unwrap_or_default(), rate["seconds"].as_f64().unwrap_or_default());
    let (values, at) = (cell(&rate["values"]), cell(&rate["measured_at"]));
    format!("{hz:.1} Hz ({values} values in {seconds:.3} s at {at})")
}

/// A value as one reads it: when, and each of its parts below its name.
fn echo(echo: &Value) -> String {
    let stamp = echo["stamp_ns"].as_u64().unwrap_or_default() as f64 / 1e9;
    let missed = match echo["missed"].as_u64() {
        None | Some(0) => String::new(),
        Some(missed) => format!(", {missed} before it were passed over"),
    };
    let mut lines = vec![format!("{} at {stamp:.6} s{missed}", cell(&echo["from"]))];
    match echo["unreadable"].as_str() {
        Some(reason) => lines.push(format!("  unreadable: {reason}")),
        None => value("", &echo["value"], "  ", &mut lines),
    }
    lines.join("\n")
}

fn value(name: &str, shown: &Value, indent: &str, lines: &mut Vec<String>) {
    let head = if name.is_empty() { indent.to_owned() } else { format!("{indent}{name}: ") };
    let deeper = if name.is_empty() { indent.to_owned() } else { format!("{indent}  ") };
    match shown {
        Value::Object(fields) => {
            if !name.is_empty() {
                lines.push(format!("{indent}{name}:"));
            }
            fields.iter().for_each(|(name, shown)| value(name, shown, &deeper, lines));
        }
        Value::Array(elements) if elements.iter().any(Value::is_object) => {
            for (index, element) in elements.iter().enumerate() {
                value(&format!("{name}[{index}]"), element, indent, lines);
            }
        }
        Value::Array(elements) => {
            let elements: Vec<String> = elements.iter().map(cell).collect();
            lines.push(format!("{head}[{}]", elements.join(", ")));
        }
        leaf => lines.push(format!("{head}{}", cell(leaf))),
    }
}

fn window(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    let fits = seconds.filter(|window| (RATE_WINDOW_MIN..=RATE_WINDOW_MAX).contains(window));
    let (min, max) = (RATE_WINDOW_MIN.as_secs_f64(), RATE_WINDOW_MAX.as_secs_f64());
    fits.ok_or_else(|| format!("`{text}` is no number of seconds from {min} to {max}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_shown_part_by_part() {
        let told = serde_json::json!({"from": "a.out", "stamp_ns": 1_500_000_000u64, "missed": 2, "unreadable": null,
            "value": {"pose": {"x": 1.5}, "names": ["b", "c"], "points": [{"y": 1}]}});
        let lines = "a.out at 1.500000 s, 2 before it were passed over\n  names: [b, c]\n  points[0]:\n    y: 1\n  pose:\n    x: 1.5";
        assert_eq!(echo(&told), lines);
        let told = serde_json::json!({"from": "a.out", "stamp_ns": 0, "missed": 0, "value": 7});
        assert_eq!(echo(&told), "a.out at 0.000000 s\n  7");
    }

    #[test]
    fn a_window_is_seconds_within_bounds() {
        assert_eq!(window("0.2"), Ok(Duration::from_millis(200)));
        assert!(["0", "-1", "x", "inf", "1e9"].iter().all(|text| window(text).is_err()));
    }
}
