//! Provokes faults for drills and tests. The fault happens in the plugin's own text, at a real instruction, so that
//! detection, containment and blame are those of a fault of the author's; no component carries test code for it.
//!
//! What is told by a component, as a lost device, is told by the same call. What lies in a value, as one outside its range or one
//! that is outvoted, and silence, which its readers find, only whoever writes can have: nothing is written in his name.
#![allow(unsafe_code, reason = "address of unsafe: faults on purpose")]

use std::hint::black_box;

use abi_stable::std_types::RStr;

use super::host;
use crate::component::Outcome;

/// What can be provoked; the number is what crosses the border.
pub const INJECTIONS: [(&str, u8); 14] = [
    ("crash.panic", 1),
    ("crash.segv", 2),
    ("crash.bus", 3),
    ("crash.fpe", 4),
    ("crash.ill", 5),
    ("crash.abort", 6),
    ("crash.stack", 7),
    ("error", 8),
    ("crash.exit", 9),
    ("hang", 10),
    ("raised", 11),
    ("device", 12),
    ("device.found", 13),
    ("overrun", OVERRUN),
];

/// Stands for the number that [`burn`] gives.
pub const OVERRUN: u8 = 14;

/// The first number of a callback that takes long.
const BURN: u8 = 128;
/// What the first of them takes, in nanoseconds; each takes an eighth more than the one before, up to half a minute.
const BURN_MIN_NS: u64 = 10_000;

/// The number of a callback that takes a little longer than that many nanoseconds; `None`: none takes that long.
#[must_use]
pub fn burn(longer_than_ns: u64) -> Option<u8> {
    (BURN..=u8::MAX).find(|code| burned_ns(*code) > longer_than_ns.saturating_add(longer_than_ns / 16))
}

/// What the callback of that number takes.
fn burned_ns(code: u8) -> u64 {
    (BURN..code).fold(BURN_MIN_NS, |ns, _| ns + ns / 8)
}

/// The device that is lost and found.
const DEVICE: &str = "injected";

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
        10 => hang(),
        11 => (host::get().raise_fault)(RStr::from_str("injected")),
        12 => (host::get().devices.lost)(RStr::from_str(DEVICE), RStr::from_str("injected loss"), 0),
        13 => (host::get().devices.found)(RStr::from_str(DEVICE)),
        BURN.. => take(burned_ns(code)),
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

/// Without a call that could wait: what does not return is the plugin's own code.
#[inline(never)]
fn hang() -> ! {
    loop {
        std::hint::spin_loop();
    }
}

fn take(ns: u64) {
    let clock = host::get().clock;
    let until_ns = clock() + ns;
    while clock() < until_ns {
        std::hint::spin_loop();
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_to_take_longer_takes_a_little_longer() {
        for longer_than_ns in [0, 9_000, 10_000, 1_000_000, 300_000_000, 20_000_000_000] {
            let ns = burned_ns(burn(longer_than_ns).unwrap());
            assert!(
                ns > longer_than_ns && ns <= (longer_than_ns + longer_than_ns / 4).max(BURN_MIN_NS),
                "{longer_than_ns}: {ns}"
            );
        }
        assert_eq!(burn(u64::MAX), None);
    }

    #[test]
    fn each_number_means_one_thing() {
        assert!(INJECTIONS.iter().all(|(name, number)| code(name) == Some(*number) && (1..BURN).contains(number)));
        assert!(INJECTIONS.windows(2).all(|pair| pair[0].1 < pair[1].1));
    }
}
