//! What the demo reads in the daemon's journal: fault lines, everything else is passed over.

use serde::Deserialize;
use serde_json::Value;

/// A fault as the journal tells it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Fault {
    kind: FaultKind,
    /// Number of the entry; a later line with the same number completes an earlier one.
    pub seq: u64,
    /// When it happened, nanoseconds of the monotonic clock.
    pub mono_ns: u64,
    /// Where.
    pub slot: String,
    /// Class of the instance that failed.
    #[serde(default)]
    pub class: String,
    /// What was seen.
    pub symptom: String,
    /// How the detector knows.
    #[serde(default)]
    pub evidence: Value,
    /// What was done: `ignore`, `reset`, `replace`, `stop`.
    pub action: String,
    /// Class that fills the slot now; the same class after a reset.
    #[serde(default)]
    pub successor: Option<String>,
    /// How it came out: `recovered`, `stopped`, `ignored`, `failed`.
    pub outcome: String,
    /// Times of the steps.
    #[serde(default)]
    pub times: Times,
    /// Whether it was injected on purpose.
    #[serde(default)]
    pub injected: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum FaultKind {
    Fault,
}

/// Nanoseconds since the fault; absent until known.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
pub struct Times {
    /// A detector saw it.
    pub detected_ns: Option<u64>,
    /// It was decided what to do.
    pub decided_ns: Option<u64>,
    /// The new instance was ready.
    pub ready_ns: Option<u64>,
    /// The new instance completed its first callback: the recovery time.
    pub first_callback_ns: Option<u64>,
}

impl Fault {
    /// Whether the component works again.
    #[must_use]
    pub fn recovered(&self) -> bool {
        self.outcome == "recovered"
    }

    /// Whether the integrator's rules say that nothing needs to be done; such a fault needs no recovery.
    #[must_use]
    pub fn ignored(&self) -> bool {
        self.outcome == "ignored"
    }

    /// The class that took the slot over, if it is another than the one that failed.
    #[must_use]
    pub fn replaced_by(&self) -> Option<&str> {
        self.successor.as_deref().filter(|successor| self.action == "replace" && *successor != self.class)
    }

    /// What was done, for people.
    #[must_use]
    pub fn how(&self) -> String {
        match (self.action.as_str(), self.replaced_by()) {
            ("replace", Some(successor)) => format!("replaced by {successor}"),
            ("replace", None) => "replaced by a spare".into(),
            ("stop", _) => "stopped".into(),
            ("ignore", _) => "ignored".into(),
            (action, _) => action.into(),
        }
    }

    /// The most telling part of the evidence, in at most `width` characters.
    #[must_use]
    pub fn told(&self, width: usize) -> String {
        shortened(&self.said(), width)
    }

    fn said(&self) -> String {
        let text = |key: &str| self.evidence.get(key).map(plain);
        if let Some(message) = text("message") {
            let place = text("location").or_else(|| Some(format!("{}:{}", text("file")?, text("line")?)));
            return place.map_or(message.clone(), |place| format!("{message} ({})", last_parts(&place)));
        }
        if let Some(function) = text("function") {
            return text("offset").map_or(function.clone(), |offset| format!("{function}+{offset}"));
        }
        let signal = self.evidence.get("signal").map(signal_name).unwrap_or_default();
        match self.evidence.get("address").map(address) {
            // Only these two tell which address was accessed.
            Some(address) if ["SIGSEGV", "SIGBUS"].contains(&signal.as_str()) => format!("{signal} at {address}"),
            _ => signal,
        }
    }
}

fn signal_name(signal: &Value) -> String {
    let name = signal.as_i64().and_then(|number| match number {
        4 => Some("SIGILL"),
        6 => Some("SIGABRT"),
        7 => Some("SIGBUS"),
        8 => Some("SIGFPE"),
        11 => Some("SIGSEGV"),
        _ => None,
    });
    name.map_or_else(|| plain(signal), String::from)
}

fn address(address: &Value) -> String {
    address.as_u64().map_or_else(|| plain(address), |number| format!("{number:#x}"))
}

/// Adds `newer` entries to `faults`; one with a known number replaces the older.
pub fn merge(faults: &mut Vec<Fault>, newer: Vec<Fault>) {
    for fault in newer {
        match faults.iter_mut().find(|known| known.seq == fault.seq) {
            Some(known) => *known = fault,
            None => faults.push(fault),
        }
    }
}

fn plain(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// The last three parts of a path: crate, `src`, file. The rest is where somebody's checkout happens to be.
fn last_parts(path: &str) -> &str {
    path.rmatch_indices('/').nth(2).map_or(path, |(at, _)| &path[at + 1..])
}

fn shortened(text: &str, width: usize) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if line.chars().count() <= width {
        return line;
    }
    line.chars().take(width.saturating_sub(1)).chain(['…']).collect()
}
