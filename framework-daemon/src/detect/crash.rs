//! How a callback ended, as a symptom.

use component_sdk::abi::class::CallStatus;

use crate::model::symptom::Symptom;
use crate::sys::trap::Trap;

/// The symptom of a trap.
#[must_use]
pub const fn of_trap(trap: &Trap) -> Symptom {
    match trap.evidence.signal {
        _ if trap.hang => Symptom::Hang,
        _ if trap.exited => Symptom::CrashExit,
        libc::SIGSEGV if trap.stack_overflow => Symptom::CrashStack,
        libc::SIGBUS => Symptom::CrashBus,
        libc::SIGFPE => Symptom::CrashFpe,
        libc::SIGILL | libc::SIGTRAP => Symptom::CrashIll,
        // SIGSYS: a fatal signal to the own process by a system call.
        libc::SIGABRT | libc::SIGSYS => Symptom::CrashAbort,
        _ => Symptom::CrashSegv,
    }
}

/// The symptom of a shim's status; `None`: it went well.
#[must_use]
pub const fn of_status(status: CallStatus) -> Option<Symptom> {
    match status {
        CallStatus::Done => None,
        CallStatus::Error => Some(Symptom::Error),
        CallStatus::Panic => Some(Symptom::CrashPanic),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::fault::TrapEvidence;

    #[test]
    fn each_signal_has_its_symptom() {
        let trap = |signal, stack_overflow| Trap {
            stack_overflow,
            exited: signal == 0,
            ..Trap::new(TrapEvidence::new(signal, 0, 0), 0)
        };
        let seen =
            [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGABRT].map(|s| of_trap(&trap(s, false)));
        use Symptom::{CrashAbort, CrashBus, CrashFpe, CrashIll, CrashSegv, CrashStack};
        assert_eq!(seen, [CrashSegv, CrashBus, CrashFpe, CrashIll, CrashAbort]);
        assert_eq!(of_trap(&trap(libc::SIGSEGV, true)), CrashStack);
        assert_eq!(of_trap(&trap(0, false)), Symptom::CrashExit);
        assert_eq!(of_trap(&Trap { hang: true, ..trap(libc::SIGSEGV, false) }), Symptom::Hang);
    }
}
