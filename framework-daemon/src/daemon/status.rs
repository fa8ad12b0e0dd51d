//! How everything is, for people and for the journal: slots with their counters, and what faults have cost the process.

use std::sync::atomic::{AtomicU64, Ordering};

use serde_json::{Map, Value, json};

use crate::exec::slot::Slot;
use crate::fault::ledger::Ledger;
use crate::model::fault::TrapEvidence;
use crate::model::lifecycle::State;
use crate::model::limits::{LOST_THREADS_MAX, QUARANTINED_MAX};
use crate::supervise::system::Placed;

/// Columns of the table, in order. Each is a field of [`of_placed`].
const COLUMNS: [&str; 9] = ["slot", "state", "class", "cycles", "missed", "faults", "quarantined", "tainted", "spares"];

/// A slot, with the state that it is or was in.
#[must_use]
pub fn of_slot(slot: &Slot, state: State) -> Value {
    let status = &slot.status;
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    json!({"slot": slot.name, "class": status.class(), "state": state, "cycles": count(&status.cycles),
        "missed": count(&status.missed), "faults": count(&status.faults),
        "quarantined": count(&status.quarantined), "tainted": count(&status.tainted),
        "longest_ns": count(&status.longest_ns)})
}

/// A slot that runs, with its spares.
#[must_use]
pub fn of_placed(placed: &Placed) -> Value {
    let (ready, wanted) = placed.shelf.stock();
    let mut fields = of_slot(&placed.slot, placed.slot.status.state());
    fields["spares"] = ready.into();
    fields["spares_wanted"] = wanted.into();
    fields
}

/// What faults have cost the process, and what they may cost.
#[must_use]
pub fn of_process(ledger: Ledger) -> Value {
    json!({"threads_lost": ledger.threads_lost, "threads_lost_max": LOST_THREADS_MAX,
        "quarantined": ledger.quarantined, "quarantined_max": QUARANTINED_MAX, "tainted": ledger.tainted})
}

/// The table that a person reads, a line each.
#[must_use]
pub fn table(slots: &[Value], ledger: Ledger) -> Vec<String> {
    let head = COLUMNS.map(str::to_owned);
    let rows: Vec<_> =
        std::iter::once(head).chain(slots.iter().map(|slot| COLUMNS.map(|name| cell(&slot[name])))).collect();
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max().unwrap_or_default();
    let widths: [usize; COLUMNS.len()] = std::array::from_fn(width);
    let line = |row: &[String; COLUMNS.len()]| {
        let cells: Vec<_> = row.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        cells.join("  ").trim_end().to_owned()
    };
    let mut lines: Vec<_> = rows.iter().map(line).collect();
    let memory = if ledger.tainted > 0 { "suspect" } else { "sound" };
    lines.push(format!(
        "threads given up: {} of at most {LOST_THREADS_MAX}; instances given up: {} of at most {QUARANTINED_MAX}; memory: {memory}",
        ledger.threads_lost, ledger.quarantined
    ));
    lines
}

fn cell(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// What is to be said of a run whose last line in the journal this is; `None`: it ended in order.
#[must_use]
pub fn last_run(last: &Map<String, Value>) -> Option<String> {
    let number = |name: &str| last.get(name).and_then(Value::as_u64).unwrap_or_default();
    match last.get("kind").and_then(Value::as_str) {
        Some("stop") => None,
        Some("start") if last.get("accepted") == Some(&Value::Bool(false)) => None,
        Some("left") => Some(format!(
            "the last run was left at once by a second signal; {} safe outputs were written",
            number("safe_outputs")
        )),
        Some("crash") => {
            let trap = TrapEvidence::new(number("signal") as i32, number("address"), number("pc"));
            Some(format!(
                "the last run ended by a crash of the daemon itself: {} at address {:#x}, {:#x} bytes into its program; \
                 {} safe outputs were written",
                trap.signal_name(),
                trap.address,
                trap.pc.saturating_sub(number("base")),
                number("safe_outputs")
            ))
        }
        _ => Some("the last run on this journal did not end in order: it was killed, or power was lost".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_aligned_and_tells_the_bounds() {
        let slot = json!({"slot": "avoider", "state": "active", "class": "AvoidancePrimary", "cycles": 12, "missed": 0,
            "faults": 3, "quarantined": 2, "tainted": 1, "spares": 1});
        let lines = table(&[slot], Ledger { threads_lost: 0, quarantined: 2, tainted: 1 });
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[0].find("class"), lines[1].find("AvoidancePrimary"));
        assert!(lines[2].ends_with("instances given up: 2 of at most 1000000; memory: suspect"), "{}", lines[2]);
    }

    #[test]
    fn only_a_run_that_did_not_end_in_order_is_told() {
        let told = |last: Value| last_run(last.as_object().unwrap());
        assert_eq!(told(json!({"kind": "stop"})), None);
        assert_eq!(told(json!({"kind": "start", "accepted": false})), None);
        assert!(told(json!({"kind": "fault"})).unwrap().contains("did not end in order"));
        assert!(told(json!({"kind": "left", "safe_outputs": 1})).unwrap().contains("second signal; 1 safe"));
        let crash =
            told(json!({"kind": "crash", "signal": 11, "address": 8, "pc": 4096, "base": 16, "safe_outputs": 2}));
        assert!(crash.unwrap().contains("SIGSEGV at address 0x8, 0xff0 bytes into its program; 2 safe outputs"));
    }
}
