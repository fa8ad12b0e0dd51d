//! x86-64: registers of a signal frame, and the few instructions that Rust has no words for.
#![allow(unsafe_code, reason = "address of unsafe: registers and instructions")]

use std::arch::asm;

use corosensei::trap::TrapHandlerRegs;

/// Direction flag and alignment check: a plugin may have left them set.
const FLAGS_CLEARED: i64 = !0x4_0400;

/// Program counter and stack pointer.
#[must_use]
pub fn position(context: &libc::ucontext_t) -> (usize, usize) {
    let registers = &context.uc_mcontext.gregs;
    (registers[libc::REG_RIP as usize] as usize, registers[libc::REG_RSP as usize] as usize)
}

/// Where a function that has no frame of its own returns to: the word on top of the stack.
///
/// # Safety
/// The stack pointer of `context` must lie in mapped memory.
#[must_use]
pub unsafe fn return_address(context: &libc::ucontext_t) -> usize {
    let (_, sp) = position(context);
    // SAFETY: the caller's promise; a stack pointer that is out of step is read all the same.
    unsafe { (sp as *const usize).read_unaligned() }
}

/// True where the program counter stands behind a system call: the thread waits in the kernel, or is about to leave it.
#[must_use]
pub fn waits(context: &libc::ucontext_t) -> bool {
    const SYSCALL: [u8; 2] = [0x0f, 0x05];
    let (pc, _) = position(context);
    // SAFETY: the bytes before an instruction that was being executed belong to the same text, but for the first of a page;
    // there the answer is no. Text is mapped readable.
    pc % 4096 >= 2 && unsafe { ((pc - 2) as *const [u8; 2]).read() } == SYSCALL
}

/// Sets the registers that the trap handler names, and the floating-point control words that the ABI promises.
pub fn redirect(context: &mut libc::ucontext_t, to: &TrapHandlerRegs) {
    let registers = &mut context.uc_mcontext.gregs;
    registers[libc::REG_RIP as usize] = to.rip as i64;
    registers[libc::REG_RSP as usize] = to.rsp as i64;
    registers[libc::REG_RBP as usize] = to.rbp as i64;
    registers[libc::REG_RDI as usize] = to.rdi as i64;
    registers[libc::REG_RSI as usize] = to.rsi as i64;
    registers[libc::REG_EFL as usize] &= FLAGS_CLEARED;
    // SAFETY: the kernel fills the pointer with the address of the saved floating-point state, or null.
    if let Some(state) = unsafe { context.uc_mcontext.fpregs.as_mut() } {
        state.cwd = 0x037f;
        state.swd = 0;
        state.mxcsr = 0x1f80;
    }
}

/// Goes on where the trap handler says, on another stack; whatever lies on this one is abandoned.
///
/// # Safety
/// The registers must come from a fiber that nobody else runs and that waits for its end.
pub unsafe fn continue_at(to: &TrapHandlerRegs) -> ! {
    // SAFETY: the caller's promise; these are all the registers that the trap handler's entry needs.
    unsafe {
        asm!("mov rsp, {sp}", "mov rbp, {bp}", "jmp {ip}",
            sp = in(reg) to.rsp, bp = in(reg) to.rbp, ip = in(reg) to.rip,
            in("rdi") to.rdi, in("rsi") to.rsi, options(noreturn));
    }
}

/// Ends the calling kernel thread: no destructor runs, nothing of its memory is freed.
pub fn end_thread() -> ! {
    // SAFETY: the system call takes no memory and does not return.
    unsafe { asm!("syscall", in("rax") libc::SYS_exit, in("rdi") 0, options(noreturn)) }
}

/// Traps, at this very instruction.
pub fn strike() {
    // SAFETY: the instruction raises SIGILL, whose handler ends the fiber or the process.
    unsafe { asm!("ud2") }
}
