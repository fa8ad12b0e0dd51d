//! Which classes of misbehaviour there are, and what is right for each.

/// How a class is provoked often.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// One slot faults, is recovered, faults again.
    Again,
    /// As many slots as faults: each takes a bait, and the callback that answers it faults; the slot stops, as its rules say.
    OnceEach,
    /// As many slots as faults, removed by a reload.
    Leaving,
    /// One slot misbehaves again and again, the daemon refuses, nobody faults.
    Refused,
}

/// One class of misbehaviour.
#[derive(Clone, Copy, Debug)]
pub struct Class {
    /// Component class of the torture plugin.
    pub component: &'static str,
    /// How its callback faults, where that can be chosen; empty: it cannot.
    pub how: &'static str,
    /// Part of the campaign that it belongs to: a file of the torture plugin.
    pub group: &'static str,
    /// Symptoms that are right.
    pub symptoms: &'static [&'static str],
    /// Symptom of the bait that leads to the faulting callback.
    pub bait: Option<&'static str>,
    /// How it is provoked often.
    pub course: Course,
    /// Its callbacks have a deadline.
    pub deadline: bool,
    /// One of the other slots shares its executor.
    pub neighbour: bool,
    /// A further slot beside the tortured one: its class and, where it asks something of it, the ports.
    pub company: Option<(&'static str, &'static str)>,
}

impl Class {
    /// `NullWrite`, `InStart.panic`.
    #[must_use]
    pub fn name(&self) -> String {
        if self.how.is_empty() { self.component.to_owned() } else { format!("{}.{}", self.component, self.how) }
    }

    const fn again(group: &'static str, component: &'static str, symptoms: &'static [&'static str]) -> Self {
        Self {
            component,
            how: "",
            group,
            symptoms,
            bait: None,
            course: Course::Again,
            deadline: false,
            neighbour: false,
            company: None,
        }
    }

    const fn hook(component: &'static str, how: &'static str, course: Course, bait: Option<&'static str>) -> Self {
        let symptoms: &[&str] = if how.len() == 5 { PANIC } else { SEGV };
        Self { how, bait, course, ..Self::again("hooks", component, symptoms) }
    }

    const fn hang(component: &'static str) -> Self {
        Self { deadline: true, ..Self::again("hangs", component, &["hang"]) }
    }

    const fn refused(self) -> Self {
        Self { course: Course::Refused, ..self }
    }

    const fn with_neighbour(self) -> Self {
        Self { neighbour: true, ..self }
    }

    /// Beside one that waits; `ports`: for an answer.
    const fn with_company(self, component: &'static str, ports: &'static str) -> Self {
        Self { company: Some((component, ports)), ..self }
    }

    const fn in_handler(how: &'static str, symptoms: &'static [&'static str]) -> Self {
        Self { how, ..Self::again("parked", "FaultInHandler", symptoms).with_company("ParkedAsker", "ask -> tell") }
    }
}

const PANIC: &[&str] = &["crash.panic"];
const SEGV: &[&str] = &["crash.segv"];
const ABORT: &[&str] = &["crash.abort"];
const EXIT: &[&str] = &["crash.exit"];
const STACK: &[&str] = &["crash.stack"];

use Course::{Again, Leaving, OnceEach};

/// Every class.
pub const CLASSES: &[Class] = &[
    Class::again("panics", "Panic", PANIC),
    Class::again("panics", "PanicInDrop", PANIC),
    Class::again("panics", "DoublePanic", ABORT),
    Class::again("instructions", "DivideByZero", &["crash.fpe"]),
    Class::again("instructions", "IllegalInstruction", &["crash.ill"]),
    Class::again("instructions", "WildJump", SEGV),
    Class::again("instructions", "NullJump", SEGV),
    Class::again("memory", "NullRead", SEGV),
    Class::again("memory", "NullWrite", SEGV),
    Class::again("memory", "WildWrite", SEGV),
    Class::again("memory", "CodeWrite", SEGV),
    Class::again("memory", "MemcpyBadAddress", SEGV),
    Class::again("memory", "StrlenBadAddress", SEGV),
    Class::again("memory", "DoubleFree", ABORT),
    Class::again("memory", "HeapCorruption", ABORT),
    Class::again("memory", "StackOverflow", STACK),
    Class::again("process", "Abort", ABORT),
    Class::again("process", "Exit", EXIT),
    // A plugin's own standard library lets a thread exit once: the second time it aborts.
    Class::again("process", "RustExit", &["crash.exit", "crash.abort"]),
    Class::again("process", "UnderscoreExit", EXIT),
    Class::again("process", "QuickExit", EXIT),
    Class::again("process", "HandlerReset", SEGV),
    Class::again("process", "SignalMask", SEGV),
    Class::again("process", "RawExit", EXIT),
    Class::again("process", "RawHandlerReset", SEGV),
    Class::again("process", "RawSignalMask", SEGV),
    Class::again("process", "RawKill", ABORT),
    Class::hang("InfiniteLoop"),
    Class::hang("AllocationLoop"),
    Class::hang("OwnDeadlock"),
    Class::hang("SleepForever"),
    Class::hang("BlockingRead"),
    Class::again("threads", "NullReadOnThread", SEGV),
    Class::again("threads", "PanicOnThread", PANIC),
    Class::again("threads", "StackOverflowOnThread", STACK),
    Class::again("threads", "AbortOnThread", ABORT),
    Class::again("float", "FloatControlThenFault", SEGV).with_neighbour(),
    Class::again("float", "FloatControlLeft", &[]).with_neighbour().refused(),
    Class::again("calls", "ForgedLoan", &[]).refused(),
    Class::again("calls", "ForgedPublish", &[]).refused(),
    Class::again("calls", "ForgedGiveBack", &[]).refused(),
    Class::again("calls", "ForgedRead", &[]).refused(),
    Class::again("calls", "BadLogText", SEGV),
    Class::again("calls", "BadRaiseText", SEGV),
    Class::again("calls", "BadDeviceName", SEGV),
    Class::again("calls", "BadDeviceFound", SEGV),
    Class::again("calls", "BadErrorText", SEGV),
    Class::again("calls", "BadPanicText", SEGV),
    Class::again("calls", "BadCriticalName", SEGV),
    Class::again("calls", "BadSafeOutput", SEGV),
    Class::again("calls", "BadCriticalRegion", SEGV),
    Class::again("calls", "BadPublishValue", &[]).refused(),
    Class::again("calls", "BadGiveBackValue", &[]).refused(),
    Class::again("calls", "StackEndWrite", STACK),
    Class::again("forged", "BadWiringName", SEGV),
    Class::again("forged", "BadUnwiringName", SEGV),
    Class::again("forged", "BadWiringReason", SEGV),
    Class::again("forged", "ForgedHandles", &[]).refused(),
    Class::again("forged", "ForgedNumbers", &[]).refused(),
    Class::again("forged", "CallsOfTheOtherSide", &[]).refused(),
    Class::again("forged", "CallsOnThread", &[]).refused(),
    Class::again("forged", "CallsInSignalHandler", &[]).refused(),
    Class::again("parked", "FaultBeside", SEGV).with_company("ParkedSleeper", ""),
    Class::again("parked", "LostBeside", ABORT).with_company("ParkedSleeper", ""),
    Class::in_handler("segv", SEGV),
    Class::in_handler("lost", ABORT),
    Class::hook("InConstructor", "segv", OnceEach, Some("crash.segv")),
    Class::hook("InConstructor", "panic", OnceEach, Some("crash.segv")),
    Class::hook("InInitialize", "segv", OnceEach, Some("crash.segv")),
    Class::hook("InInitialize", "panic", OnceEach, Some("crash.segv")),
    Class::hook("InStart", "segv", OnceEach, Some("crash.segv")),
    Class::hook("InStart", "panic", OnceEach, Some("crash.segv")),
    Class::hook("InRehearse", "segv", OnceEach, Some("crash.segv")),
    Class::hook("InRehearse", "panic", OnceEach, Some("crash.segv")),
    Class::hook("InRecover", "segv", OnceEach, Some("crash.segv")),
    Class::hook("InRecover", "panic", OnceEach, Some("crash.segv")),
    Class::hook("InOnError", "segv", OnceEach, Some("crash.panic")),
    Class::hook("InOnError", "panic", OnceEach, Some("crash.panic")),
    Class::hook("InReset", "segv", OnceEach, Some("crash.panic")),
    Class::hook("InReset", "panic", OnceEach, Some("crash.panic")),
    Class::hook("InUpdate", "segv", Again, None),
    Class::hook("InUpdate", "panic", Again, None),
    Class::hook("InStop", "segv", Leaving, None),
    Class::hook("InStop", "panic", Leaving, None),
    Class::hook("InDestroy", "segv", Leaving, None),
    Class::hook("InDestroy", "panic", Leaving, None),
    Class::hook("InDrop", "segv", Leaving, None),
    Class::hook("InDrop", "panic", Leaving, None),
];

/// The classes of a group.
#[must_use]
pub fn group(name: &str) -> Vec<&'static Class> {
    CLASSES.iter().filter(|class| class.group == name).collect()
}
