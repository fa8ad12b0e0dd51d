//! Whether memory may be damaged after a fault: by the signal, the address, and where it struck.
//!
//! A null page is an ordinary bug: the access was meant for an object that was not there, and it went nowhere. A wild address
//! was computed from something that had been overwritten, and the next such access may hit.

use crate::model::fault::{Memory, TrapEvidence};
use crate::model::limits::NULL_PAGE_BYTES;
use crate::model::symptom::Symptom;
use crate::sys::trap::{Site, Trap};

/// `si_code` of a fault that the kernel cannot give an address to: one outside the processor's range.
const SI_KERNEL: i32 = 0x80;

/// Of a trap that was seen as `symptom`.
#[must_use]
pub const fn of_trap(symptom: Symptom, trap: &Trap) -> Memory {
    match symptom {
        Symptom::CrashExit => Memory::Sound,
        // One that the component did not ask for is the C library's: a check of the heap or of a stack failed.
        Symptom::CrashAbort if trap.asked => Memory::Sound,
        // As in the allocator: its lists may be half-changed, whatever it was that struck there.
        _ if symptom.is_crash() && matches!(trap.site, Site::Elsewhere) => Memory::Suspect,
        Symptom::CrashSegv if is_null(&trap.evidence) => Memory::Sound,
        Symptom::CrashSegv | Symptom::CrashBus | Symptom::CrashAbort => Memory::Suspect,
        _ => Memory::Sound,
    }
}

const fn is_null(trap: &TrapEvidence) -> bool {
    trap.address < NULL_PAGE_BYTES && trap.code != SI_KERNEL
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::detect::crash;

    fn trap(signal: i32, address: u64, asked: bool) -> Trap {
        Trap { asked, site: Site::Plugin, ..Trap::new(TrapEvidence::new(signal, address, 0), 0) }
    }

    fn judged(trap: &Trap) -> Memory {
        of_trap(crash::of_trap(trap), trap)
    }

    #[test]
    fn ordinary_bugs_leave_memory_sound() {
        for trap in [
            trap(libc::SIGSEGV, 0, false),
            trap(libc::SIGSEGV, 0xffff, false),
            trap(libc::SIGFPE, 0x7f00_0000_1234, false),
            trap(libc::SIGILL, 0x7f00_0000_1234, false),
            trap(libc::SIGABRT, 0, true),
            Trap { exited: true, ..trap(libc::SIGABRT, 0, true) },
            Trap { stack_overflow: true, ..trap(libc::SIGSEGV, 0x7f00_0000_1234, false) },
        ] {
            assert_eq!(judged(&trap), Memory::Sound, "{trap:?}");
        }
    }

    #[test]
    fn wild_ones_do_not() {
        let mut beyond = trap(libc::SIGSEGV, 0, false);
        beyond.evidence.code = SI_KERNEL;
        for trap in [
            beyond,
            trap(libc::SIGSEGV, 0x1_0000, false),
            trap(libc::SIGSEGV, 0xdead_beef, false),
            trap(libc::SIGBUS, 0, false),
            trap(libc::SIGABRT, 0, false),
        ] {
            assert_eq!(judged(&trap), Memory::Suspect, "{trap:?}");
        }
    }

    #[test]
    fn whatever_strikes_in_the_allocator_is_suspect_and_a_hang_is_not() {
        let elsewhere = Trap { site: Site::Elsewhere, ..trap(libc::SIGSEGV, 0, false) };
        assert_eq!(judged(&elsewhere), Memory::Suspect);
        assert_eq!(judged(&Trap { stack_overflow: true, ..elsewhere }), Memory::Suspect);
        assert_eq!(judged(&Trap { hang: true, ..elsewhere }), Memory::Sound);
        assert_eq!(judged(&Trap { exited: true, ..elsewhere }), Memory::Sound);
    }

    proptest! {
        /// What is held for suspect in a plugin's own text is not held for sound where a lock may be held.
        #[test]
        fn the_allocator_never_makes_it_better(signal in 1..32i32, address: u64, asked: bool, exited: bool) {
            let here = Trap { exited, ..trap(signal, address, asked) };
            let there = Trap { site: Site::Elsewhere, ..here };
            prop_assert!(judged(&here) == Memory::Sound || judged(&there) == Memory::Suspect);
        }

        #[test]
        fn an_access_is_sound_in_the_null_page_only(address: u64) {
            let sound = judged(&trap(libc::SIGSEGV, address, false)) == Memory::Sound;
            prop_assert_eq!(sound, address < NULL_PAGE_BYTES);
        }
    }
}
