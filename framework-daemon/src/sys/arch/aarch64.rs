//! aarch64: registers of a signal frame, and the few instructions that Rust has no words for.
#![allow(unsafe_code, reason = "address of unsafe: registers and instructions")]

use std::arch::asm;

use corosensei::trap::TrapHandlerRegs;

use crate::model::fault::Registers;

/// Program counter and stack pointer.
#[must_use]
pub fn position(context: &libc::ucontext_t) -> (usize, usize) {
    (context.uc_mcontext.pc as usize, context.uc_mcontext.sp as usize)
}

/// Where a function that has no frame of its own returns to: the link register.
///
/// # Safety
/// None here; it is one where the address lies on the stack.
#[must_use]
pub unsafe fn return_address(context: &libc::ucontext_t) -> usize {
    context.uc_mcontext.regs[30] as usize
}

/// True where the program counter stands behind a system call: the thread waits in the kernel, or is about to leave it.
#[must_use]
pub fn waits(context: &libc::ucontext_t) -> bool {
    const SVC_0: u32 = 0xd400_0001;
    let (pc, _) = position(context);
    // SAFETY: the word before an instruction that was being executed belongs to the same text, but for the first of a
    // page; there the answer is no. Text is mapped readable.
    pc % 4096 >= 4 && unsafe { ((pc - 4) as *const u32).read() } == SVC_0
}

/// Sets the floating-point control word that the ABI promises, where a callback left another one behind: its neighbours
/// would compute otherwise. Looked at first, because setting it takes longer.
#[inline]
pub fn restore_float_control() {
    let control: u64;
    // SAFETY: reads a register.
    unsafe { asm!("mrs {}, fpcr", out(reg) control, options(nomem, nostack, preserves_flags)) };
    if control != 0 {
        // SAFETY: the value that every function may expect.
        unsafe { asm!("msr fpcr, {}", in(reg) 0u64, options(nomem, nostack, preserves_flags)) };
    }
}

/// Goes on where the trap handler says, on another stack; whatever lies on this one is abandoned.
///
/// # Safety
/// The registers must come from a fiber that nobody else runs and that waits for its end.
pub unsafe fn continue_at(to: &TrapHandlerRegs) -> ! {
    // SAFETY: the caller's promise; these are all the registers that the trap handler's entry needs.
    unsafe {
        asm!("mov sp, {sp}", "mov x29, {fp}", "mov x30, {lr}", "br {pc}",
            sp = in(reg) to.sp, fp = in(reg) to.x29, lr = in(reg) to.lr, pc = in(reg) to.pc,
            in("x0") to.x0, in("x1") to.x1, options(noreturn));
    }
}

/// Words that are not aligned may be read and written anyway.
#[inline]
pub const fn allow_unaligned() {}

/// Fetches the cache line of that address, to be written to. Whatever the address is, nothing traps.
#[inline]
pub fn fetch_line(address: usize) {
    // SAFETY: a hint.
    unsafe { asm!("prfm pstl1keep, [{}]", in(reg) address, options(nostack, preserves_flags)) };
}

/// Traps, at this very instruction.
pub fn strike() {
    // SAFETY: the instruction raises SIGILL, whose handler ends the fiber or the process.
    unsafe { asm!("udf 0") }
}

/// System calls that put a descriptor in the place of another one.
pub const OVERWRITES: [i64; 2] = [libc::SYS_dup3; 2];

/// As the kernel names this processor to a filter of system calls.
pub const AUDIT_ARCH: u32 = 0xC000_00B7;

/// A system call from the daemon's own text, where no fence stands.
///
/// # Safety
/// The arguments must be what that call may be given.
pub unsafe fn system_call(number: i64, arguments: [usize; 6]) -> isize {
    let [a, b, c, d, e, f] = arguments;
    let mut result = a as isize;
    // SAFETY: the registers are those of the kernel's convention; it changes none but the result, and memory.
    unsafe {
        asm!("svc 0", in("x8") number, inlateout("x0") result, in("x1") b, in("x2") c, in("x3") d,
            in("x4") e, in("x5") f, options(nostack));
    }
    result
}

/// Goes on where `from` was interrupted.
pub fn resume(context: &mut libc::ucontext_t, from: &libc::ucontext_t) {
    context.uc_mcontext = from.uc_mcontext;
    context.uc_sigmask = from.uc_sigmask;
}

/// What the interrupted system call was given.
#[must_use]
pub fn arguments(context: &libc::ucontext_t) -> [usize; 6] {
    std::array::from_fn(|register| context.uc_mcontext.regs[register] as usize)
}

/// Sets what the interrupted system call returns.
pub fn set_result(context: &mut libc::ucontext_t, result: isize) {
    context.uc_mcontext.regs[0] = result as u64;
}

/// General registers and flags, for the evidence of a trap.
#[must_use]
pub fn registers(context: &libc::ucontext_t) -> Registers {
    let mut values = [0; 32];
    values[..31].copy_from_slice(&context.uc_mcontext.regs);
    values[31] = context.uc_mcontext.pstate;
    Registers::new(values)
}

/// The return address that a register holds, until the function calls another.
#[must_use]
pub const fn link(context: &libc::ucontext_t) -> Option<u64> {
    Some(context.uc_mcontext.regs[30])
}
