//! What faults cost for good, against its bounds: threads that were given up, instances that are never freed. Pure.
//!
//! Beyond a bound the daemon asks its supervisor for a restart, in order and with a reason, instead of dying of leaks.

use serde::Serialize;

use crate::model::fault::{FaultEvent, Memory, RestartRequest};
use crate::model::limits::{LOST_THREADS_MAX, QUARANTINED_MAX};

/// What was counted since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ledger {
    /// Threads that were given up: those of executors, and those that plugins started.
    pub threads_lost: u64,
    /// Instances that are never entered again and never freed.
    pub quarantined: u64,
    /// Faults after which memory may be damaged.
    pub tainted: u64,
}

/// What follows from a count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Half of a bound is reached.
    Warn(String),
    /// Time to begin anew.
    Restart(RestartRequest),
}

impl Ledger {
    /// Enters a fault; `threads_lost` were given up by then.
    pub fn note(&mut self, event: &FaultEvent, threads_lost: u64, restart_on_taint: bool) -> Option<Verdict> {
        let (before, fault) = (*self, &event.fault);
        self.tainted += u64::from(fault.memory == Memory::Suspect);
        self.quarantined += u64::from(fault.symptom.loses_instance());
        self.threads_lost = threads_lost.max(before.threads_lost);
        let taint = (fault.memory == Memory::Suspect && restart_on_taint).then(|| taint(event));
        taint
            .or_else(|| judge(before.threads_lost, self.threads_lost, LOST_THREADS_MAX, "threads"))
            .or_else(|| judge(before.quarantined, self.quarantined, QUARANTINED_MAX, "instances"))
    }
}

fn judge(before: u64, now: u64, max: u64, what: &str) -> Option<Verdict> {
    let told = || format!("{now} {what} were given up for faults, of at most {max}");
    if now >= max {
        return Some(Verdict::Restart(RestartRequest { reason: told() }));
    }
    (before..now).contains(&(max / 2 - 1)).then(|| Verdict::Warn(told()))
}

fn taint(event: &FaultEvent) -> Verdict {
    let FaultEvent { slot, fault, .. } = event;
    let (symptom, message) = (fault.symptom.name(), fault.evidence.text());
    let reason = format!(
        "memory is suspect after {symptom} of slot {slot} ({message}), and the system profile says on_taint=\"restart\""
    );
    Verdict::Restart(RestartRequest { reason })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::fault::{Evidence, Fault, Outcome, Times, TrapEvidence};
    use crate::model::ladder::Answer;
    use crate::model::symptom::{Severity, Symptom};

    fn event(symptom: Symptom, memory: Memory) -> FaultEvent {
        let evidence = Evidence::Trap(TrapEvidence::new(libc::SIGSEGV, 0, 0));
        FaultEvent {
            slot: "s",
            class: "C",
            fault: Fault { memory, ..Fault::told(symptom, 1, evidence) },
            severity: Severity::Reset,
            answer: Answer::Reset,
            successor: None,
            outcome: Outcome::Recovered,
            checkpoint_ns: None,
            cause: None,
            times: Times::default(),
        }
    }

    #[test]
    fn a_panic_costs_nothing_for_good() {
        let mut ledger = Ledger::default();
        assert_eq!(ledger.note(&event(Symptom::CrashPanic, Memory::Sound), 0, true), None);
        assert_eq!(ledger, Ledger::default());
    }

    #[test]
    fn half_of_a_bound_is_warned_of_once_and_the_bound_asks_for_a_restart() {
        let (mut ledger, lost) = (Ledger::default(), event(Symptom::Hang, Memory::Sound));
        let verdicts: Vec<_> = (1..=LOST_THREADS_MAX).filter_map(|count| ledger.note(&lost, count, false)).collect();
        assert!(matches!(verdicts.as_slice(), [Verdict::Warn(_), Verdict::Restart(_)]), "{verdicts:?}");
        assert_eq!((ledger.threads_lost, ledger.quarantined), (LOST_THREADS_MAX, LOST_THREADS_MAX));
    }

    #[test]
    fn many_at_once_are_warned_of_as_well() {
        let (mut ledger, lost) = (Ledger::default(), event(Symptom::Hang, Memory::Sound));
        assert!(matches!(ledger.note(&lost, LOST_THREADS_MAX - 1, false), Some(Verdict::Warn(_))));
        assert_eq!(ledger.note(&lost, LOST_THREADS_MAX - 1, false), None);
    }

    #[test]
    fn suspect_memory_is_counted_and_asks_for_a_restart_only_where_the_profile_says_so() {
        let (mut ledger, wild) = (Ledger::default(), event(Symptom::CrashSegv, Memory::Suspect));
        assert_eq!(ledger.note(&wild, 0, false), None);
        let asked = ledger.note(&wild, 0, true);
        assert!(matches!(asked, Some(Verdict::Restart(request)) if request.reason.contains("on_taint")));
        assert_eq!((ledger.tainted, ledger.quarantined), (2, 2));
    }
}
