//! Instructions that trap.

use std::hint::black_box;

torture! {
    /// Divides by zero, as compiled C does.
    DivideByZero => divide_by_zero;

    /// Executes an instruction that there is none of.
    IllegalInstruction => illegal;

    /// Calls a function at an address where nothing is mapped.
    WildJump => || jump(0x6ead_beef_0000);

    /// Calls a function pointer that is null.
    NullJump => || jump(0);
}

#[cfg(target_arch = "x86_64")]
fn divide_by_zero() {
    // SAFETY: none; the division faults, which is its purpose.
    unsafe {
        std::arch::asm!("xor edx, edx", "div {zero:e}", zero = in(reg) 0u32, inout("eax") 1u32 => _, out("edx") _);
    }
}

/// Division by zero does not trap here: what a compiler's check would raise is raised.
#[cfg(not(target_arch = "x86_64"))]
fn divide_by_zero() {
    // SAFETY: `raise` takes no memory.
    unsafe { libc::raise(libc::SIGFPE) };
}

fn illegal() {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: none; the instruction faults, which is its purpose.
    unsafe {
        std::arch::asm!("ud2");
    }
    #[cfg(target_arch = "aarch64")]
    // SAFETY: none; the instruction faults, which is its purpose.
    unsafe {
        std::arch::asm!("udf #0");
    }
}

fn jump(address: usize) {
    let target = std::ptr::without_provenance::<()>(black_box(address));
    // SAFETY: none; the call faults, which is its purpose. The detour over `Option` keeps null a value.
    let call = unsafe { std::mem::transmute_copy::<*const (), Option<extern "C" fn()>>(&target) };
    match call {
        Some(call) => call(),
        None => null_call(),
    }
}

#[cfg(target_arch = "x86_64")]
fn null_call() {
    // SAFETY: none; the call faults, which is its purpose.
    unsafe { std::arch::asm!("call {null}", null = in(reg) 0usize, clobber_abi("C")) };
}

#[cfg(target_arch = "aarch64")]
fn null_call() {
    // SAFETY: none; the call faults, which is its purpose.
    unsafe { std::arch::asm!("blr {null}", null = in(reg) 0usize, clobber_abi("C")) };
}
