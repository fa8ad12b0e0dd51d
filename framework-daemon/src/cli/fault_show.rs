//! `fault show`: one fault with all that is known of it, and what followed.

use std::io::{self, Write};

use serde_json::{Value, json};

use super::exit_code::Exit;
use super::fault::{listed, row};
use super::remote::{Remote, fields, parameters};
use crate::control::views::cell;
use crate::model::limits::FEED_LINES;

/// For its help.
pub(super) const EXAMPLES: &str = "Examples:\n  framework-daemon fault show 7\n  \
     framework-daemon fault show 7 --format json | jq '.follows[].slot'\n\n\
     Numbers are those of `fault list` and of the journal, which has all; the daemon keeps the newest 1024.\n\n\
     Exit codes: 0 shown, 5 no daemon can be reached, 6 it has none of that number.";

/// What is shown of a fault besides its evidence, in order.
const FIELDS: [&str; 15] = [
    "seq",
    "kind",
    "time",
    "slot",
    "class",
    "symptom",
    "severity",
    "consequence_of",
    "action",
    "outcome",
    "successor",
    "checkpoint",
    "memory",
    "thread_lost",
    "injected",
];

/// Asks.
///
/// # Errors
/// Only those of writing.
pub(super) fn run(seq: u64, remote: &Remote, out: &mut impl Write) -> io::Result<Exit> {
    let asked = parameters([("last", Some(FEED_LINES.into()))]);
    remote.pick("ListFaults", asked, "faults", out, |lines| find(seq, lines), show)
}

/// The line of that number, and those that follow from it.
fn find(seq: u64, lines: &[Value]) -> Result<Value, String> {
    let fault = lines.iter().find(|line| line["seq"] == seq);
    let fault = fault.ok_or_else(|| {
        format!("there is no line {seq} about faults among the newest {FEED_LINES}; `fault list` shows them, the journal has all")
    })?;
    let follows = |line: &&Value| line["diagnosis"]["consequence_of"] == seq || line["root"] == seq;
    // What it heals by, or is cleared by, is the first of that after it and before the same is a fault again.
    let same = |line: &&Value| {
        ["slot", "symptom"].iter().all(|name| line[*name] == fault[*name])
            && ["port", "device", "field"].iter().all(|name| line["evidence"][*name] == fault["evidence"][*name])
    };
    let after = lines.iter().filter(|line| line["seq"].as_u64() > Some(seq) && fault["kind"] == "fault");
    let ends = after.filter(same).take_while(|line| line["kind"] != "fault");
    let mut rest: Vec<&Value> = lines.iter().filter(follows).chain(ends).collect();
    rest.sort_by_key(|line| line["seq"].as_u64());
    Ok(json!({"fault": fault, "follows": rest}))
}

fn show(found: &Value) -> Vec<String> {
    let fault = &found["fault"];
    let mut shown = fault.clone();
    shown["time"] = row(fault)["time"].clone();
    for name in ["severity", "consequence_of"] {
        shown[name] = fault["diagnosis"][name].clone();
    }
    let told: Vec<&str> = FIELDS.into_iter().filter(|name| !shown[*name].is_null()).collect();
    let mut lines = fields(&shown, &told);
    lines.push(format!("evidence: {}", cell(&row(fault)["evidence"])));
    lines.extend(inside(&fault["evidence"]));
    if let Some(times) = fault["times"].as_object() {
        lines.push("times after the fault".to_owned());
        let us = |ns: &Value| ns.as_f64().unwrap_or_default() / 1e3;
        lines.extend(times.iter().map(|(step, ns)| format!("  {:<15} {:.1} us", step.trim_end_matches("_ns"), us(ns))));
    }
    let follows = found["follows"].as_array().map(Vec::as_slice).unwrap_or_default();
    if !follows.is_empty() {
        lines.push("what follows from it".to_owned());
        lines.extend(listed(follows).into_iter().map(|line| format!("  {line}")));
    }
    lines
}

/// Fields of an object, a line each, those of objects in it likewise.
fn inside(object: &Value) -> Vec<String> {
    let fields = object.as_object().into_iter().flatten();
    let lines = fields.flat_map(|(name, value)| match value {
        Value::Object(_) => {
            let inner = inside(value).into_iter().map(|line| format!("  {line}"));
            std::iter::once(format!("  {name}")).chain(inner).collect()
        }
        _ => vec![format!("  {name:<15} {}", cell(value))],
    });
    lines.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_shown_with_what_follows_and_its_end_and_nothing_else() {
        let device = |seq: u64, kind: &str, device: &str| {
            json!({"seq": seq, "kind": kind, "slot": "board", "symptom": "device", "wall": 0.0,
                "evidence": {"kind": "device", "device": device, "message": "gone"},
                "diagnosis": {"severity": "stop"}, "times": {"detected_ns": 1500}})
        };
        let lines = [
            device(3, "fault", "left"),
            device(4, "fault", "right"),
            json!({"seq": 5, "kind": "held", "slot": "planner", "root": 3, "wall": 0.0, "reason": "needs board"}),
            device(6, "healed", "left"),
            device(7, "fault", "left"),
            device(8, "healed", "left"),
        ];
        let found = find(3, &lines).unwrap();
        let follows: Vec<_> = found["follows"].as_array().unwrap().iter().map(|line| line["seq"].as_u64()).collect();
        assert_eq!(follows, [Some(5), Some(6)]);
        let text = show(&found).join("\n");
        for wanted in ["severity  stop", "evidence: left is lost: gone", "detected        1.5 us", "needs board"] {
            assert!(text.contains(wanted), "{wanted} in\n{text}");
        }
        assert!(find(99, &lines).unwrap_err().contains("no line 99"));
    }
}
