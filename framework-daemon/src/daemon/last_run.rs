//! How the last run on this journal ended, as far as its last line tells.

use serde_json::{Map, Value};

use crate::model::fault::TrapEvidence;

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
