//! A fault event: what joins detection, which sits low, and handling, which sits high. Plain data.
//!
//! Everything in [`Fault`](crate::model::fault::Fault) is `Copy` and of fixed size, because it is put together on the recovery path, where nothing
//! allocates; [`FaultEvent`](crate::model::fault::FaultEvent) is made from it afterwards.

use serde::Serialize;

use super::ladder::Answer;
use super::limits::CALLERS;
pub use super::registers::Registers;
use super::symptom::{Severity, Symptom};
pub use super::text::{Label, ShortText, Text};

/// What a detector saw.
#[derive(Clone, Copy, Debug)]
pub struct Fault {
    /// The symptom.
    pub symptom: Symptom,
    /// Monotonic time of the fault in nanoseconds: of the faulting instruction where it was provoked, of the signal
    /// handler's entry or the callback's return else.
    pub at_ns: u64,
    /// When it was seen: the signal handler's entry, or the callback's return.
    pub detected_ns: u64,
    /// It was provoked by a drill.
    pub injected: bool,
    /// The callback's thread was given up; another one runs the executor now.
    pub thread_lost: bool,
    /// Whether memory may be damaged.
    pub memory: Memory,
    /// Whether it begins or is over.
    pub stage: Stage,
    /// What it rests on.
    pub evidence: Evidence,
}

impl Fault {
    /// One that a component told of by itself, now.
    #[must_use]
    pub const fn told(symptom: Symptom, now_ns: u64, evidence: Evidence) -> Self {
        Self {
            symptom,
            at_ns: now_ns,
            detected_ns: now_ns,
            injected: false,
            thread_lost: false,
            memory: Memory::Sound,
            stage: Stage::Confirmed,
            evidence,
        }
    }
}

/// Where a fault that lasts stands: a value that is bad, a silence. What was only suspected is no fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// It is certain: from now on it is a fault.
    #[default]
    Confirmed,
    /// The first good value after it.
    Healed,
    /// It has been good for as long as it had to be bad.
    Cleared,
}

impl Stage {
    /// What a line of the journal about it is called.
    #[must_use]
    pub const fn kind(self) -> &'static str {
        match self {
            Self::Confirmed => "fault",
            Self::Healed => "healed",
            Self::Cleared => "cleared",
        }
    }
}

/// What is presumed of the memory that a component shares with all others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Memory {
    /// The fault was an ordinary bug.
    #[default]
    Sound,
    /// Something may have been written where it does not belong.
    Suspect,
}

/// What a symptom rests on.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Evidence {
    /// A signal.
    Trap(TrapEvidence),
    /// A panic.
    Panic {
        /// Its message.
        message: ShortText,
        /// Source file, or the end of its path.
        file: Label,
        /// Line in it.
        line: u32,
    },
    /// A text: what a callback returned or a component raised.
    Text {
        /// The text.
        message: ShortText,
    },
    /// A callback that took longer than it may.
    Time {
        /// What it took, in nanoseconds.
        took_ns: u64,
        /// Its budget, in nanoseconds.
        budget_ns: u64,
    },
    /// A recovery that took longer than declared.
    Recovery {
        /// Fault to first good callback, in nanoseconds; to the start of the instance where no callback follows by itself.
        took_ns: u64,
        /// What `<recovery within>` says, in nanoseconds.
        declared_ns: u64,
    },
    /// A value outside its range.
    Value {
        /// Port that carried it.
        port: Label,
        /// Field that holds it.
        field: Label,
        /// The value.
        value: f64,
        /// The bound that it crossed.
        limit: f64,
    },
    /// A signal that is not what its model says.
    Model {
        /// Slot and port that sent it.
        port: Label,
        /// Field that was compared.
        field: Label,
        /// The signal, filtered: its mean, or its change per second.
        target: f64,
        /// The model, likewise.
        model: f64,
        /// By how much they differ.
        difference: f64,
        /// By how much they may.
        threshold: f64,
        /// Over which time they were filtered, in nanoseconds.
        window_ns: u64,
    },
    /// A value that does not agree with what others measured.
    Vote {
        /// Slot and port that sent it.
        port: Label,
        /// Field that was voted over.
        field: Label,
        /// What it said.
        value: f64,
        /// What the others agreed on.
        agreed: f64,
        /// How many they are.
        agreeing: u32,
        /// Largest difference that counts as equal.
        tolerance: f64,
    },
    /// A vote in which too few agreed.
    Quorum {
        /// Voter and port that should have handed something on.
        port: Label,
        /// Field that was voted over.
        field: Label,
        /// How many agreed.
        agreeing: u32,
        /// How many must.
        require: u32,
        /// How many may vote.
        members: u32,
        /// It is over because it was forgiven together with the emergency stop, not because enough agree.
        #[serde(skip_serializing_if = "std::ops::Not::not")]
        forgiven: bool,
    },
    /// A device that does not work, or works again.
    Device {
        /// Its name, which the component gave it.
        device: Label,
        /// Why it does not.
        #[serde(skip_serializing_if = "Text::is_empty")]
        message: ShortText,
        /// The system's number of the error.
        #[serde(skip_serializing_if = "Option::is_none")]
        os_error: Option<i32>,
        /// For how long it was lost, in nanoseconds, where it was found.
        #[serde(skip_serializing_if = "is_zero")]
        lost_ns: u64,
        /// The instance that told of it.
        #[serde(skip)]
        instance: u64,
    },
    /// Nothing arrived.
    Silence {
        /// Slot and port that waited.
        port: Label,
        /// For how long nothing arrived, in nanoseconds.
        silent_ns: u64,
        /// For how long it may, in nanoseconds.
        max_age_ns: u64,
    },
}

/// A signal and where it struck.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TrapEvidence {
    /// Signal number.
    pub signal: i32,
    /// What caused it, as the kernel tells it in `si_code`.
    pub code: i32,
    /// Address that was accessed, or that holds the instruction.
    pub address: u64,
    /// Program counter.
    pub pc: u64,
    /// Stack pointer.
    pub sp: u64,
    /// Return addresses into plugins, nearest first, as far as the top of the stack tells; 0: no more.
    #[serde(skip)]
    pub callers: [u64; CALLERS],
    /// The other registers.
    pub registers: Registers,
}

impl Evidence {
    /// [`Self::text`] where it outlives the fault.
    #[must_use]
    pub const fn lasting_text(&self) -> Option<&'static str> {
        match self {
            Self::Trap(trap) => Some(trap.signal_name()),
            Self::Time { .. } => Some("it returned late"),
            Self::Recovery { .. } => Some("it recovered later than declared"),
            _ => None,
        }
    }

    /// The text handed to `on_error` and `recover`: no copy, because a recovery waits for it.
    #[must_use]
    pub fn text(&self) -> &str {
        match self {
            Self::Trap(trap) => trap.signal_name(),
            Self::Panic { message, .. } | Self::Text { message } => message.as_str(),
            Self::Value { field, .. } => field.as_str(),
            Self::Device { device, .. } => device.as_str(),
            Self::Silence { port, .. }
            | Self::Model { port, .. }
            | Self::Vote { port, .. }
            | Self::Quorum { port, .. } => port.as_str(),
            Self::Time { .. } => "it returned late",
            Self::Recovery { .. } => "it recovered later than declared",
        }
    }
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
const fn is_zero(number: &u64) -> bool {
    *number == 0
}

impl TrapEvidence {
    /// A signal and where it struck, without what a handler knows besides.
    #[must_use]
    pub const fn new(signal: i32, address: u64, pc: u64) -> Self {
        Self { signal, code: 0, address, pc, sp: 0, callers: [0; CALLERS], registers: Registers::UNKNOWN }
    }

    /// `SIGSEGV` and kin.
    #[must_use]
    pub const fn signal_name(&self) -> &'static str {
        match self.signal {
            libc::SIGSEGV => "SIGSEGV",
            libc::SIGBUS => "SIGBUS",
            libc::SIGFPE => "SIGFPE",
            libc::SIGILL => "SIGILL",
            libc::SIGABRT => "SIGABRT",
            libc::SIGSYS => "SIGSYS",
            libc::SIGTRAP => "SIGTRAP",
            _ => "it does not return",
        }
    }
}

/// How the handling of a fault ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// The slot works again.
    Recovered,
    /// The slot is stopped.
    Stopped,
    /// Nothing was done.
    Ignored,
    /// It was the fault of a recovery itself; the ladder went on.
    Failed,
    /// It is left to the answer to its root.
    Consequence,
}

/// Times of the steps, nanoseconds after the fault.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Times {
    /// It was seen.
    pub detected_ns: u64,
    /// The answer was looked up.
    pub decided_ns: u64,
    /// The successor, or the reset instance, was started.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ready_ns: Option<u64>,
    /// Its first callback was completed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_callback_ns: Option<u64>,
}

/// A fault with what was done about it, on its way to the fault manager.
#[derive(Clone, Debug)]
pub struct FaultEvent {
    /// Blamed slot.
    pub slot: &'static str,
    /// Class of the blamed instance.
    pub class: &'static str,
    /// What was seen.
    pub fault: Fault,
    /// How severe the rules say it is.
    pub severity: Severity,
    /// What was done.
    pub answer: Answer,
    /// Class that fills the slot now; `None`: nobody does.
    pub successor: Option<&'static str>,
    /// How it ended.
    pub outcome: Outcome,
    /// Age in nanoseconds of the checkpoint that the successor went on from.
    pub checkpoint_ns: Option<u64>,
    /// Slot whose fault it is left to; `None`: it was answered itself.
    pub cause: Option<&'static str>,
    /// When.
    pub times: Times,
}

/// Asks the main loop to end in order, so that the daemon's supervisor starts it anew.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RestartRequest {
    /// Why.
    pub reason: String,
}

/// Where executors put fault events; the fault manager holds the other end. Bounded: what does not fit is counted.
pub type FaultSender = crossbeam_channel::Sender<FaultEvent>;
