//! How the last run on this journal ended, as far as its last line tells; and the emergency stop that it left latched.

use std::sync::PoisonError;

use serde_json::{Map, Value, json};

use super::{Settings, held, note};
use crate::fault::manager::SharedJournal;
use crate::model::fault::TrapEvidence;
use crate::profile::plan::Plan;
use crate::sys::latch::{self, Left, Record};

/// What is to be said of a run whose last line in the journal this is; `None`: it ended in order.
#[must_use]
pub(super) fn tell(last: &Map<String, Value>) -> Option<String> {
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

/// What the file of the latch is to say of this run.
pub(super) fn record(settings: &Settings, plan: &Plan) -> Record {
    let directory = std::fs::canonicalize(&settings.directory).unwrap_or_else(|_| settings.directory.clone());
    let class =
        |name: &String| plan.slots.iter().find(|slot| slot.name == *name).map(|slot| slot.component.name.clone());
    let classes = plan.system.emergency.iter().map(|name| class(name).unwrap_or_default()).collect();
    Record::new(directory.to_string_lossy().into_owned(), plan.system.emergency.clone()).of_classes(classes)
}

/// The emergency stop stays latched until an operator clears it, whatever ended the run before. Slots that were its actuators
/// then are so in this run, whatever its profiles say: somebody may have changed them meanwhile, and the robot is the same ([`held`]).
pub(super) fn restore_latch(settings: &Settings, plan: &mut Plan, journal: &SharedJournal) {
    let path = latch::beside(&settings.journal);
    // What the journal still tells of nobody removes by removing a file.
    let missed = journal.lock().unwrap_or_else(PoisonError::into_inner).leaves_emergency();
    let link = latch::link_beside(&settings.called);
    let left = latch::keep(&path, link.as_deref(), record(settings, plan), missed, settings.fresh);
    let (told, record) = match &left {
        Left::Free => return,
        Left::Latched(record) => (of_record(record), Some(record)),
        Left::Unknown(reason) => {
            (format!("nobody can tell whether the run before left it latched: {}: {reason}", path.display()), None)
        }
    };
    let mut fields =
        json!({"step": if settings.fresh { "forgotten" } else { "restored" }, "file": path, "left": record});
    if let Left::Unknown(reason) = &left {
        fields["failure"] = reason.as_str().into();
    }
    if settings.fresh {
        note(journal, "emergency", &fields);
        return tracing::warn!("the emergency stop is forgotten, as --fresh says; {told}");
    }
    tracing::error!("EMERGENCY STOP: {told}; actuators stay stopped until `fault clear`");
    let besides = record.map(|record| held::hold(plan, record)).unwrap_or_default();
    fields["besides"] = json!(besides);
    note(journal, "emergency", &fields);
    if plan.system.emergency.is_empty() && besides.is_empty() {
        tracing::warn!("no slot of these profiles is an actuator: the emergency stop holds none of them");
    }
    latch::hold_besides(besides);
}

fn of_record(record: &Record) -> String {
    let cause = record.cause.as_ref().map(|cause| format!(" for {cause}")).unwrap_or_default();
    let again = record.again.as_ref().map(|again| format!(", {again}")).unwrap_or_default();
    format!("the run before left it latched{cause}{again}; its profiles: {}", record.profiles)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn only_a_run_that_did_not_end_in_order_is_told() {
        let told = |last: Value| tell(last.as_object().unwrap());
        assert_eq!(told(json!({"kind": "stop"})), None);
        assert_eq!(told(json!({"kind": "start", "accepted": false})), None);
        assert!(told(json!({"kind": "fault"})).unwrap().contains("did not end in order"));
        assert!(told(json!({"kind": "left", "safe_outputs": 1})).unwrap().contains("second signal; 1 safe"));
        let crash =
            told(json!({"kind": "crash", "signal": 11, "address": 8, "pc": 4096, "base": 16, "safe_outputs": 2}));
        assert!(crash.unwrap().contains("SIGSEGV at address 0x8, 0xff0 bytes into its program; 2 safe outputs"));
    }
}
