//! `fault`: what failed in a running daemon, and what was done about it.

use std::io::{self, Write};

use clap::{Args, Subcommand};
use serde_json::{Map, Value};

use super::component::ordered;
use super::exit_code::Exit;
use super::fault_show;
use super::remote::{Remote, parameters};
use crate::control::views::{cell, table};
use crate::model::fault::TrapEvidence;

const EXAMPLES: &str = "Examples:\n  framework-daemon fault list --last 20\n  framework-daemon fault show 7\n  \
     framework-daemon fault follow --slot avoider\n\n\
     The daemon keeps the newest 1024; the journal has all.\n\n\
     Exit codes: 0 answered, 5 no daemon can be reached, 6 refused.";

const LIST_EXAMPLES: &str = "Examples:\n  framework-daemon fault list\n  framework-daemon fault list --slot avoider --last 5\n  \
     framework-daemon fault list --format json | jq -r 'select(.outcome == \"stopped\") | .slot'\n\n\
     Times of day are UTC. `took` is the time from the fault to the first completed callback.";

const CLEAR_EXAMPLES: &str = "Examples:\n  framework-daemon fault clear\n\n\
     Exit codes: 0 cleared, 5 no daemon can be reached, 6 refused: none is latched, 7 it stays: it was raised again at this moment.";

const FOLLOW_EXAMPLES: &str = "Examples:\n  framework-daemon fault follow\n  \
     framework-daemon fault follow --slot avoider --last 10 --format json\n\n\
     With --format json each line is {\"fault\": ...} as the journal has it, or {\"missed\": N} where faults came faster than they \
     were read.";

/// Columns with the widths that they have while faults are followed: nobody knows yet what comes.
const COLUMNS: [(&str, usize); 8] = [
    ("seq", 5),
    ("time", 12),
    ("slot", 16),
    ("symptom", 11),
    ("action", 7),
    ("outcome", 9),
    ("took", 9),
    ("evidence", 0),
];

/// Arguments of `fault`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// What about them.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What about faults.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// List the newest faults, oldest first.
    #[command(after_help = LIST_EXAMPLES)]
    List {
        /// Only those of this slot, or voter.
        #[arg(long, value_name = "SLOT")]
        slot: Option<String>,
        /// How many at most.
        #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..))]
        last: u64,
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
    /// Show one fault: its evidence, what was done, how long each step took, and what followed from it.
    #[command(after_help = fault_show::EXAMPLES)]
    Show {
        /// Its number in the journal, as `fault list` tells it.
        #[arg(value_name = "SEQ")]
        seq: u64,
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
    /// Take the emergency stop back: actuators start again.
    #[command(after_help = CLEAR_EXAMPLES)]
    Clear {
        /// Which daemon, and how it is printed.
        #[command(flatten)]
        remote: Remote,
    },
    /// Print faults as they happen, until told to stop.
    #[command(after_help = FOLLOW_EXAMPLES)]
    Follow {
        /// Only those of this slot, or voter.
        #[arg(long, value_name = "SLOT")]
        slot: Option<String>,
        /// Begin with that many of those before.
        #[arg(long, value_name = "N", default_value_t = 0)]
        last: u64,
        /// End after that many lines.
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
    let asked = |slot: &Option<String>, last: u64| {
        parameters([("slot", slot.as_deref().map(Value::from)), ("last", Some(last.into()))])
    };
    match &arguments.verb {
        Verb::List { slot, last, remote } => remote.list("ListFaults", asked(slot, *last), "faults", out, listed),
        Verb::Show { seq, remote } => fault_show::run(*seq, remote, out),
        Verb::Clear { remote } => remote.ask_patiently("ClearEmergency", Map::new(), out, |answer| {
            let actuators = answer["actuators"].as_array().into_iter().flatten().map(ordered);
            let head = match super::status::raised_for(answer) {
                raised if raised.is_empty() => "the emergency stop is cleared".to_owned(),
                raised => format!("the emergency stop{raised} is cleared"),
            };
            let failure = answer["failure"].as_str().map(|why| format!("but the next run may come up latched: {why}"));
            std::iter::once(head).chain(failure).chain(actuators).collect()
        }),
        Verb::Follow { slot, last, count, remote } => {
            remote.follow("Follow", asked(slot, *last), *count, out, followed)
        }
    }
}

/// Lines of the fault manager as a table.
pub(super) fn listed(lines: &[Value]) -> Vec<String> {
    table(&COLUMNS.map(|(name, _)| name), &lines.iter().map(row).collect::<Vec<_>>())
}

/// A line of what is followed.
fn followed(answer: &Value) -> String {
    if let Some(missed) = answer["missed"].as_u64() {
        return format!("{missed} lines came faster than they were read; the journal has them");
    }
    let row = row(&answer["fault"]);
    let cells = COLUMNS.map(|(name, width)| format!("{:<width$}", cell(&row[name])));
    cells.join("  ").trim_end().to_owned()
}

/// A line of the fault manager, by columns.
pub(super) fn row(line: &Value) -> Value {
    let mut row =
        serde_json::json!({"seq": line["seq"], "time": time_of_day(line["wall"].as_f64().unwrap_or_default())});
    if let Some(count) = line["count"].as_u64() {
        row["evidence"] = format!("{count} faults came faster than they could be written down").into();
        return row;
    }
    for name in ["slot", "symptom", "action", "outcome"] {
        row[name] = line[name].clone();
    }
    if line["symptom"].is_null() {
        row["symptom"] = line["kind"].clone();
        row["action"] = line["step"].as_str().or(line["verb"].as_str()).into();
        row["outcome"] = line["state"].clone();
        let root = line["root"].as_u64().map(|root| format!("fault {root}"));
        let told = [line["reason"].as_str().map(str::to_owned), root];
        row["evidence"] = told.into_iter().flatten().collect::<Vec<_>>().join(", ").into();
        return row;
    }
    row["took"] = line["times"]["first_callback_ns"].as_f64().map(|ns| format!("{:.1} us", ns / 1e3)).into();
    row["evidence"] = evidence(&line["evidence"]).into();
    row
}

/// What it rests on, in a few words.
fn evidence(evidence: &Value) -> String {
    let text = |name: &str| cell(&evidence[name]);
    match evidence["kind"].as_str() {
        Some("trap") => {
            let place = evidence["function"].as_str().or(evidence["caller"].as_str()).unwrap_or("an unknown function");
            let number = evidence["signal"].as_i64().and_then(|number| i32::try_from(number).ok()).unwrap_or_default();
            let trap = TrapEvidence::new(number, evidence["address"].as_u64().unwrap_or_default(), 0);
            match number {
                libc::SIGSEGV | libc::SIGBUS => format!("{} at {:#x} in {place}", trap.signal_name(), trap.address),
                _ => format!("{} in {place}", trap.signal_name()),
            }
        }
        Some("panic") => format!("{} ({}:{})", text("message"), text("file"), text("line")),
        Some("text") => text("message"),
        Some("time") => {
            let ms = |name: &str| evidence[name].as_f64().unwrap_or_default() / 1e6;
            format!("took {:.3} ms of {:.3} ms", ms("took_ns"), ms("budget_ns"))
        }
        Some("recovery") => {
            let ms = |name: &str| evidence[name].as_f64().unwrap_or_default() / 1e6;
            format!("took {:.3} ms, declared {:.3} ms", ms("took_ns"), ms("declared_ns"))
        }
        Some("device") => match evidence["lost_ns"].as_f64() {
            Some(ns) => format!("{} works again after {:.1} ms", text("device"), ns / 1e6),
            None => format!("{} is lost: {}", text("device"), text("message")),
        },
        Some("silence") => {
            let ms = |name: &str| evidence[name].as_f64().unwrap_or_default() / 1e6;
            format!("{} heard nothing for {:.1} ms of {:.1} ms", text("port"), ms("silent_ns"), ms("max_age_ns"))
        }
        Some("model") => format!(
            "{} {} is {}, its model {}, difference {} of {}",
            text("port"),
            text("field"),
            text("target"),
            text("model"),
            text("difference"),
            text("threshold")
        ),
        Some("vote") => format!(
            "{} {} is {}, {} others agree on {}",
            text("port"),
            text("field"),
            text("value"),
            text("agreeing"),
            text("agreed")
        ),
        Some("quorum") => {
            format!(
                "{} {}: {} of {} agree, {} must{}",
                text("port"),
                text("field"),
                text("agreeing"),
                text("members"),
                text("require"),
                if evidence["forgiven"] == true { ", forgiven" } else { "" }
            )
        }
        Some("value") => format!("{} {} is {}, limit {}", text("port"), text("field"), text("value"), text("limit")),
        _ => String::new(),
    }
}

/// `14:03:59.250` of seconds since 1970, in UTC.
fn time_of_day(seconds: f64) -> String {
    let millis = (seconds.max(0.0) * 1e3) as u64 % 86_400_000;
    let (seconds, millis) = (millis / 1000, millis % 1000);
    format!("{:02}:{:02}:{:02}.{millis:03}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_fault_is_one_line() {
        let line = json!({"seq": 7, "wall": 1_700_000_000.25, "slot": "avoider", "symptom": "crash.segv", "action": "reset",
            "outcome": "recovered", "times": {"first_callback_ns": 2300},
            "evidence": {"kind": "trap", "signal": 11, "address": 8, "function": "ticker::step"}});
        assert_eq!(
            followed(&json!({"fault": line})),
            "7      22:13:20.250  avoider           crash.segv   reset    recovered  2.3 us     SIGSEGV at 0x8 in ticker::step"
        );
        assert!(followed(&json!({"missed": 7})).starts_with("7 lines"));
        assert!(
            followed(&json!({"fault": {"kind": "lost", "count": 3, "wall": 0.0}})).contains("3 faults came faster")
        );
    }

    #[test]
    fn each_kind_of_evidence_has_words() {
        let panic = json!({"kind": "panic", "message": "no", "file": "a.rs", "line": 3});
        assert_eq!(evidence(&panic), "no (a.rs:3)");
        assert_eq!(evidence(&json!({"kind": "text", "message": "lost"})), "lost");
        let time = json!({"kind": "time", "took_ns": 2_500_000, "budget_ns": 1_000_000});
        assert_eq!(evidence(&time), "took 2.500 ms of 1.000 ms");
        let silence = json!({"kind": "silence", "port": "a.in", "silent_ns": 120_000_000, "max_age_ns": 100_000_000});
        assert_eq!(evidence(&silence), "a.in heard nothing for 120.0 ms of 100.0 ms");
        let lost = json!({"kind": "device", "device": "sonar", "message": "gone"});
        assert_eq!(evidence(&lost), "sonar is lost: gone");
        let found = json!({"kind": "device", "device": "sonar", "lost_ns": 1_500_000});
        assert_eq!(evidence(&found), "sonar works again after 1.5 ms");
        let late = json!({"kind": "recovery", "took_ns": 3_000_000, "declared_ns": 2_000_000});
        assert_eq!(evidence(&late), "took 3.000 ms, declared 2.000 ms");
        let few = json!({"kind": "quorum", "port": "v.out", "field": "x", "agreeing": 1, "members": 3, "require": 2,
            "forgiven": true});
        assert_eq!(evidence(&few), "v.out x: 1 of 3 agree, 2 must, forgiven");
        let value = json!({"kind": "value", "port": "ranges", "field": "min", "value": 9.5, "limit": 3.0});
        assert_eq!(evidence(&value), "ranges min is 9.5, limit 3.0");
    }
}
