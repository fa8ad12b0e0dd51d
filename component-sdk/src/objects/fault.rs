//! What the fault manager tells and is told: its ports are those of the slot `fault_manager`.
//!
//! | port | is | carries |
//! |---|---|---|
//! | `faults` | an event server | a [`FaultNotice`] for each fault that the [`FaultFilter`] of an activation matches |
//! | `all_faults` | an event output | a [`FaultNotice`] for each fault |
//! | `report` | an event input | a [`FaultReport`]: a fault of another slot, or of the one that reports |
//!
//! ```
//! use component_sdk::objects::{FaultFilter, FaultNotice};
//! use component_sdk::prelude::*;
//!
//! /// Hears of the avoider's crashes.
//! #[derive(Component)]
//! #[component(name = "Nurse", nonperiodic)]
//! pub struct Nurse {
//!     #[port(handler = on_fault)]
//!     faults: EventClient<FaultFilter, FaultNotice>,
//! }
//!
//! impl Callbacks for Nurse {
//!     fn start(&mut self, _: &mut Context<'_>) -> Outcome {
//!         self.faults.activate(Mode::Continuous, FaultFilter::default().slot("avoider").symptom("crash"))?;
//!         Ok(())
//!     }
//! }
//!
//! impl Nurse {
//!     fn on_fault(&mut self, cx: &mut Context<'_>, _: EventId<FaultNotice>, fault: &FaultNotice) -> Outcome {
//!         info!(cx, "{}: {}: {}", fault.slot(), fault.symptom(), fault.outcome());
//!         Ok(())
//!     }
//! }
//! ```

use component_sdk_derive::CommObject;

use crate::object::CommObject;

const SLOT_BYTES: usize = 64;
const WORD_BYTES: usize = 16;
const MESSAGE_BYTES: usize = 160;

/// Severities, from the least one on.
const SEVERITIES: [&str; 4] = ["ignore", "reset", "stop", "emergency"];

/// As much of a text as has room, whole characters; zeros behind it.
fn bytes<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    let end = (0..=N.min(text.len())).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
    bytes
}

/// The text up to the first zero, as far as it is one.
fn text(bytes: &[u8]) -> &str {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    match std::str::from_utf8(&bytes[..end]) {
        Ok(text) => text,
        Err(error) => std::str::from_utf8(&bytes[..error.valid_up_to()]).unwrap_or_default(),
    }
}

/// A fault, as the journal tells of it. Plain data of one size: nothing is allocated for it.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultNotice {
    /// Its number in the journal.
    pub sequence: u64,
    /// When it happened: monotonic time in nanoseconds.
    pub at_ns: u64,
    /// Fault to the first good callback, in nanoseconds; 0: there was none yet.
    pub recovered_ns: u64,
    slot: [u8; SLOT_BYTES],
    symptom: [u8; WORD_BYTES],
    severity: [u8; WORD_BYTES],
    outcome: [u8; WORD_BYTES],
    message: [u8; MESSAGE_BYTES],
}

impl FaultNotice {
    /// One of that slot; names that are too long are cut.
    #[must_use]
    pub fn new(sequence: u64, at_ns: u64, slot: &str, symptom: &str) -> Self {
        let mut notice = Self::empty();
        (notice.sequence, notice.at_ns) = (sequence, at_ns);
        (notice.slot, notice.symptom) = (bytes(slot), bytes(symptom));
        notice
    }

    /// What it was taken for, and what became of it.
    #[must_use]
    pub fn with(mut self, severity: &str, outcome: &str, message: &str) -> Self {
        (self.severity, self.outcome, self.message) = (bytes(severity), bytes(outcome), bytes(message));
        self
    }

    /// The slot that was blamed.
    #[must_use]
    pub fn slot(&self) -> &str {
        text(&self.slot)
    }

    /// `crash.segv`, `error`, `late`, ...
    #[must_use]
    pub fn symptom(&self) -> &str {
        text(&self.symptom)
    }

    /// `ignore`, `reset`, `stop`, `emergency`.
    #[must_use]
    pub fn severity(&self) -> &str {
        text(&self.severity)
    }

    /// `recovered`, `stopped`, `ignored`, `failed`.
    #[must_use]
    pub fn outcome(&self) -> &str {
        text(&self.outcome)
    }

    /// Signal, panic message, error text.
    #[must_use]
    pub fn message(&self) -> &str {
        text(&self.message)
    }
}

/// Which faults somebody wants to hear of. The empty one matches all.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultFilter {
    slot: [u8; SLOT_BYTES],
    symptom: [u8; WORD_BYTES],
    least: [u8; WORD_BYTES],
}

impl Default for FaultFilter {
    fn default() -> Self {
        Self::empty()
    }
}

impl FaultFilter {
    /// Of that slot only.
    #[must_use]
    pub fn slot(mut self, slot: &str) -> Self {
        self.slot = bytes(slot);
        self
    }

    /// Of that symptom only; `crash` is every `crash.*`.
    #[must_use]
    pub fn symptom(mut self, symptom: &str) -> Self {
        self.symptom = bytes(symptom);
        self
    }

    /// Of that severity, and of those beyond it: `ignore`, `reset`, `stop`, `emergency`. A word that is none matches nothing.
    #[must_use]
    pub fn least(mut self, severity: &str) -> Self {
        self.least = bytes(severity);
        self
    }

    /// True of a fault that it asks for.
    #[must_use]
    pub fn matches(&self, fault: &FaultNotice) -> bool {
        let (slot, symptom, least) = (text(&self.slot), text(&self.symptom), text(&self.least));
        let place = |word: &str| SEVERITIES.iter().position(|severity| *severity == word);
        let is_symptom =
            |told: &str| told == symptom || told.strip_prefix(symptom).is_some_and(|rest| rest.starts_with('.'));
        let is_severe = || place(least).is_some_and(|least| place(fault.severity()).is_some_and(|told| told >= least));
        (slot.is_empty() || slot == fault.slot())
            && (symptom.is_empty() || is_symptom(fault.symptom()))
            && (least.is_empty() || is_severe())
    }
}

/// A fault that a component saw of another slot. That slot is charged with the symptom `raised`, and its rules say what
/// follows; who reported it is in the evidence.
#[repr(C)]
#[derive(CommObject, Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaultReport {
    slot: [u8; SLOT_BYTES],
    message: [u8; MESSAGE_BYTES],
}

impl FaultReport {
    /// Of that slot; without a name, of the one that reports.
    #[must_use]
    pub fn new(slot: &str, message: &str) -> Self {
        Self { slot: bytes(slot), message: bytes(message) }
    }

    /// The slot that is blamed.
    #[must_use]
    pub fn slot(&self) -> &str {
        text(&self.slot)
    }

    /// What was seen.
    #[must_use]
    pub fn message(&self) -> &str {
        text(&self.message)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn notice(slot: &str, symptom: &str, severity: &str) -> FaultNotice {
        FaultNotice::new(1, 2, slot, symptom).with(severity, "recovered", "SIGSEGV")
    }

    #[test]
    fn a_filter_asks_for_slot_symptom_and_severity() {
        let fault = notice("avoider", "crash.segv", "reset");
        let all = FaultFilter::default();
        let matching = [
            all,
            all.slot("avoider"),
            all.symptom("crash"),
            all.symptom("crash.segv"),
            all.least("ignore"),
            all.slot("avoider").symptom("crash").least("reset"),
        ];
        assert!(matching.iter().all(|filter| filter.matches(&fault)));
        let others = [
            all.slot("avoid"),
            all.symptom("crash.s"),
            all.symptom("cras"),
            all.least("stop"),
            all.least("severe"),
            all.slot("avoider").least("emergency"),
        ];
        assert!(!others.iter().any(|filter| filter.matches(&fault)));
    }

    #[test]
    fn texts_are_cut_at_whole_characters_and_strange_bytes_are_none() {
        let long = "ä".repeat(100);
        assert_eq!(notice(&long, "error", "stop").slot(), "ä".repeat(32));
        let mut report = FaultReport::new("sonar", &long);
        assert_eq!(report.message(), "ä".repeat(80));
        report.message = [0xFF; MESSAGE_BYTES];
        assert_eq!((report.slot(), report.message()), ("sonar", ""));
    }
}
