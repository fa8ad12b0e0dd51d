//! Provokes faults for drills and tests. The fault happens in the plugin's own text, at a real instruction, so that
//! detection, containment and blame are those of a fault of the author's; no component carries test code for it.
#![allow(unsafe_code, reason = "address of unsafe: faults on purpose")]

use std::hint::black_box;

use super::host;
use crate::component::Outcome;

/// What can be provoked; the number is what crosses the border.
pub const INJECTIONS: [(&str, u8); 9] = [
    ("crash.panic", 1),
    ("crash.segv", 2),
    ("crash.bus", 3),
    ("crash.fpe", 4),
    ("crash.ill", 5),
    ("crash.abort", 6),
    ("crash.stack", 7),
    ("error", 8),
    ("crash.exit", 9),
];

/// The number of a symptom that can be provoked.
#[must_use]
pub fn code(symptom: &str) -> Option<u8> {
    INJECTIONS.iter().find(|(name, _)| *name == symptom).map(|(_, code)| *code)
}

/// Provokes the fault of that number.
pub(super) fn provoke(code: u8) -> Outcome {
    match code {
        2 => segv(),
        3 => raw::bus(),
        4 => raw::fpe(),
        5 => raw::ill(),
        _ => return provoke_by_call(code),
    }
    Ok(())
}

/// Those that are more than one instruction.
fn provoke_by_call(code: u8) -> Outcome {
    note();
    match code {
        1 => panic!("injected panic"),
        6 => std::process::abort(),
        7 => _ = black_box(overflow(1)),
        9 => std::process::exit(3),
        _ => return Err(crate::fault!("injected error")),
    }
    Ok(())
}

/// The fault comes with the next instruction: what lies between counts as its detection.
#[inline(always)]
fn note() {
    (host::get().note_injection)();
}

#[inline(never)]
fn segv() {
    note();
    // SAFETY: none; the write faults, which is its purpose.
    unsafe { black_box(8 as *mut u32).write_volatile(1) };
}

#[inline(never)]
#[allow(unconditional_recursion, reason = "the stack is to overflow")]
fn overflow(depth: u64) -> u64 {
    let frame = black_box([depth; 64]);
    overflow(depth + 1) + frame[(depth % 64) as usize]
}

#[cfg(target_arch = "x86_64")]
mod raw {
    use std::arch::asm;

    /// A stack access at a non-canonical address is a stack-segment fault, which Linux reports as SIGBUS.
    pub(super) fn bus() {
        super::note();
        // SAFETY: none; the load faults, which is its purpose. The asm restores what it changes before that matters.
        unsafe {
            asm!("mov {t}, rbp", "mov rbp, {wild}", "mov {wild}, [rbp]", "mov rbp, {t}",
                t = out(reg) _, wild = inout(reg) 0x8000_0000_0000_0000u64 => _);
        }
    }

    pub(super) fn fpe() {
        super::note();
        // SAFETY: none; the division faults, which is its purpose.
        unsafe { asm!("xor edx, edx", "div {zero:e}", zero = in(reg) 0u32, inout("eax") 1u32 => _, out("edx") _) };
    }

    pub(super) fn ill() {
        super::note();
        // SAFETY: none; the instruction faults, which is its purpose.
        unsafe { asm!("ud2") };
    }
}

#[cfg(not(target_arch = "x86_64"))]
mod raw {
    unsafe extern "C" {
        fn raise(signal: i32) -> i32;
    }

    /// Division by zero does not trap here, nor is there a portable way to SIGBUS: these two are raised.
    pub(super) fn bus() {
        super::note();
        // SAFETY: `raise` is the C library's; the signal numbers are Linux's on this architecture.
        unsafe { raise(7) };
    }

    pub(super) fn fpe() {
        super::note();
        // SAFETY: as in `bus`.
        unsafe { raise(8) };
    }

    pub(super) fn ill() {
        super::note();
        // SAFETY: as in `bus`.
        unsafe { raise(4) };
    }
}
