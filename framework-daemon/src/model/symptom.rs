//! Symptoms (what a detector saw) and severities (what the integrator wants done about them).
//!
//! The names are contract: profiles, journal and command line use them (`crash.segv`, `hang`, ...).

use serde::{Serialize, Serializer};

/// What a detector saw.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Symptom {
    /// The callback panicked; caught inside the plugin.
    CrashPanic,
    /// SIGSEGV: access to memory that is not mapped or not allowed.
    CrashSegv,
    /// SIGBUS: misaligned access or a page that its file no longer backs.
    CrashBus,
    /// SIGFPE: integer division by zero or overflow.
    CrashFpe,
    /// SIGILL: an instruction that the processor does not know.
    CrashIll,
    /// SIGABRT: `abort()`, a double panic, a failed check of the C library.
    CrashAbort,
    /// The fiber's stack is exhausted.
    CrashStack,
    /// The component called `exit` or one of its kin.
    CrashExit,
    /// A callback returned an error.
    Error,
    /// A callback did not return within its deadline.
    Hang,
    /// A callback returned, but later than its deadline.
    Overrun,
    /// A value left its valid range.
    Validity,
    /// A value changed faster than allowed.
    Rate,
    /// A value is too old: silence is a fault too.
    Stale,
    /// The two ends of a connection carry different objects.
    Type,
    /// A reference model disagrees with the component.
    Model,
    /// A voter outvoted the component.
    Vote,
    /// A component raised the fault itself.
    Raised,
    /// A device was lost.
    Device,
    /// A recovery missed its declared target.
    Late,
    /// A queue that may lose nothing overflowed.
    Overload,
}

impl Symptom {
    /// Every symptom, in declaration order: `ALL[s as usize] == s`.
    pub const ALL: [Self; 21] = [
        Self::CrashPanic,
        Self::CrashSegv,
        Self::CrashBus,
        Self::CrashFpe,
        Self::CrashIll,
        Self::CrashAbort,
        Self::CrashStack,
        Self::CrashExit,
        Self::Error,
        Self::Hang,
        Self::Overrun,
        Self::Validity,
        Self::Rate,
        Self::Stale,
        Self::Type,
        Self::Model,
        Self::Vote,
        Self::Raised,
        Self::Device,
        Self::Late,
        Self::Overload,
    ];

    /// How many symptoms there are: the width of a table indexed by `symptom as usize`.
    pub const COUNT: usize = Self::ALL.len();

    /// The name used in profiles, journal and command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::CrashPanic => "crash.panic",
            Self::CrashSegv => "crash.segv",
            Self::CrashBus => "crash.bus",
            Self::CrashFpe => "crash.fpe",
            Self::CrashIll => "crash.ill",
            Self::CrashAbort => "crash.abort",
            Self::CrashStack => "crash.stack",
            Self::CrashExit => "crash.exit",
            Self::Error => "error",
            Self::Hang => "hang",
            Self::Overrun => "overrun",
            Self::Validity => "validity",
            Self::Rate => "rate",
            Self::Stale => "stale",
            Self::Type => "type",
            Self::Model => "model",
            Self::Vote => "vote",
            Self::Raised => "raised",
            Self::Device => "device",
            Self::Late => "late",
            Self::Overload => "overload",
        }
    }

    /// The symptom of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|symptom| symptom.name() == name)
    }

    /// True for all `crash.*`.
    #[must_use]
    pub const fn is_crash(self) -> bool {
        (self as usize) <= (Self::CrashExit as usize)
    }

    /// True where the instance must never be entered again: it ended in the middle of an instruction.
    #[must_use]
    pub const fn loses_instance(self) -> bool {
        (self.is_crash() && !matches!(self, Self::CrashPanic)) || matches!(self, Self::Hang)
    }
}

impl Serialize for Symptom {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// What the integrator wants done about a symptom, mildest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Journal it, go on.
    Ignore,
    /// Reset within the restart intensity; beyond it replace; then stop.
    Reset,
    /// Stop the slot.
    Stop,
    /// Bring the robot to its safe state.
    Emergency,
}

impl Severity {
    /// Every severity, mildest first.
    pub const ALL: [Self; 4] = [Self::Ignore, Self::Reset, Self::Stop, Self::Emergency];

    /// The name used in profiles.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ignore => "ignore",
            Self::Reset => "reset",
            Self::Stop => "stop",
            Self::Emergency => "emergency",
        }
    }

    /// The severity of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|severity| severity.name() == name)
    }
}

/// One severity per symptom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeverityTable([Severity; Symptom::COUNT]);

impl SeverityTable {
    /// What holds where the integrator says nothing: as in OPRoS, a crash, hang or error stops the slot;
    /// every other symptom is journaled only.
    #[must_use]
    pub fn opros_default() -> Self {
        let mut table = [Severity::Ignore; Symptom::COUNT];
        for symptom in Symptom::ALL {
            if symptom.is_crash() || matches!(symptom, Symptom::Hang | Symptom::Error) {
                table[symptom as usize] = Severity::Stop;
            }
        }
        Self(table)
    }

    /// The severity of `symptom`.
    #[must_use]
    pub const fn get(&self, symptom: Symptom) -> Severity {
        self.0[symptom as usize]
    }

    /// Sets the severity of `symptom`.
    pub fn set(&mut self, symptom: Symptom, severity: Severity) {
        self.0[symptom as usize] = severity;
    }
}

impl Default for SeverityTable {
    fn default() -> Self {
        Self::opros_default()
    }
}

impl Serialize for SeverityTable {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(Symptom::ALL.into_iter().map(|symptom| (symptom.name(), self.get(symptom))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_symptoms_is_in_order_and_its_names_are_unique() {
        for (index, symptom) in Symptom::ALL.into_iter().enumerate() {
            assert_eq!(symptom as usize, index);
            assert_eq!(Symptom::from_name(symptom.name()), Some(symptom));
        }
    }

    #[test]
    fn a_panic_keeps_its_instance_and_a_trap_loses_it() {
        assert!(!Symptom::CrashPanic.loses_instance());
        assert!(Symptom::CrashSegv.loses_instance());
        assert!(Symptom::Hang.loses_instance());
        assert!(!Symptom::Error.loses_instance());
    }
}
