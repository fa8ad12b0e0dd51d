//! The processor's floating-point control word: whoever changes it changes his neighbours' arithmetic.

use super::memory::write;

torture! {
    /// Rounds towards zero and flushes small numbers from now on, then faults.
    FloatControlThenFault => || {
        set_control();
        write(24);
    };

    /// Rounds towards zero and flushes small numbers from now on, and returns as if nothing were.
    FloatControlLeft => set_control;
}

/// Round towards zero, flush denormals.
#[cfg(target_arch = "x86_64")]
fn set_control() {
    let control = 0xff80u32;
    // SAFETY: all exceptions stay masked; what rounds otherwise is the fault.
    unsafe { std::arch::asm!("ldmxcsr [{control}]", control = in(reg) &raw const control) };
}

/// Round towards zero, flush denormals.
#[cfg(target_arch = "aarch64")]
fn set_control() {
    // SAFETY: no exception is enabled; what rounds otherwise is the fault.
    unsafe { std::arch::asm!("msr fpcr, {control}", control = in(reg) 0x01c0_0000u64) };
}
