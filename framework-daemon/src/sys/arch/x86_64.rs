//! x86-64: registers of a signal frame, and the few instructions that Rust has no words for.
#![allow(unsafe_code, reason = "address of unsafe: registers and instructions")]

use std::arch::asm;

use corosensei::trap::TrapHandlerRegs;

use crate::model::fault::Registers;

/// Flags as every function may expect them.
const FLAGS: i32 = 0x202;
/// The flag that makes an access to a word that is not aligned trap.
const ALIGNMENT_CHECK: i32 = 0x4_0000;

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

/// Rounds to nearest, keeps small numbers, masks all exceptions.
static FLOAT_CONTROL: u32 = 0x1f80;
/// What exceptions left behind: it changes nothing.
const FLOAT_STATUS: u32 = 0x3f;

/// Sets the floating-point control word that the ABI promises, where a callback left another one behind: its neighbours
/// would compute otherwise. Looked at first, because setting it takes longer.
#[inline]
pub fn restore_float_control() {
    let mut control = std::mem::MaybeUninit::<u32>::uninit();
    // SAFETY: writes the control word into `control`.
    let control = unsafe {
        asm!("stmxcsr [{}]", in(reg) control.as_mut_ptr(), options(nostack, preserves_flags));
        control.assume_init()
    };
    if control & !FLOAT_STATUS != FLOAT_CONTROL {
        // SAFETY: the value that every function may expect.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const FLOAT_CONTROL, options(nostack, preserves_flags)) };
    }
}

/// Goes on where the trap handler says, on another stack; whatever lies on this one is abandoned.
///
/// # Safety
/// The registers must come from a fiber that nobody else runs and that waits for its end.
pub unsafe fn continue_at(to: &TrapHandlerRegs) -> ! {
    // SAFETY: the caller's promise; these are all the registers that the trap handler's entry needs. Below its stack pointer
    // nothing is kept.
    unsafe {
        asm!("mov rsp, {sp}", "mov rbp, {bp}", "push {flags}", "popfq", "jmp {ip}",
            sp = in(reg) to.rsp, bp = in(reg) to.rbp, ip = in(reg) to.rip, flags = const FLAGS,
            in("rdi") to.rdi, in("rsi") to.rsi, options(noreturn));
    }
}

/// Lets this thread read and write words that are not aligned, whatever the code that a signal interrupted had forbidden:
/// the kernel leaves that flag as it was.
#[inline]
pub fn allow_unaligned() {
    // SAFETY: writes the flags back with one bit cleared; without `nostack`, so that what lies below the stack pointer is
    // nobody's.
    unsafe { asm!("pushfq", "and qword ptr [rsp], {kept}", "popfq", kept = const !ALIGNMENT_CHECK) };
}

/// Fetches the cache line of that address, to be written to. Whatever the address is, nothing traps.
#[inline]
pub fn fetch_line(address: usize) {
    // SAFETY: a hint.
    unsafe { asm!("prefetchw [{}]", in(reg) address, options(nostack, preserves_flags)) };
}

/// Traps, at this very instruction.
pub fn strike() {
    // SAFETY: the instruction raises SIGILL, whose handler ends the fiber or the process.
    unsafe { asm!("ud2") }
}

/// System calls that put a descriptor in the place of another one.
pub const OVERWRITES: [i64; 2] = [libc::SYS_dup2, libc::SYS_dup3];

/// As the kernel names this processor to a filter of system calls.
pub const AUDIT_ARCH: u32 = 0xC000_003E;

/// A system call from the daemon's own text, where no fence stands.
///
/// # Safety
/// The arguments must be what that call may be given.
pub unsafe fn system_call(number: i64, arguments: [usize; 6]) -> isize {
    let mut result = number as isize;
    let [a, b, c, d, e, f] = arguments;
    // SAFETY: the registers are those of the kernel's convention; it changes rcx and r11 only, and memory.
    unsafe {
        asm!("syscall", inlateout("rax") result, in("rdi") a, in("rsi") b, in("rdx") c, in("r10") d,
            in("r8") e, in("r9") f, out("rcx") _, out("r11") _, options(nostack));
    }
    result
}

/// Goes on where `from` was interrupted.
pub fn resume(context: &mut libc::ucontext_t, from: &libc::ucontext_t) {
    context.uc_mcontext.gregs = from.uc_mcontext.gregs;
    context.uc_mcontext.fpregs = from.uc_mcontext.fpregs;
    context.uc_sigmask = from.uc_sigmask;
}

/// What the interrupted system call was given.
#[must_use]
pub fn arguments(context: &libc::ucontext_t) -> [usize; 6] {
    let order = [libc::REG_RDI, libc::REG_RSI, libc::REG_RDX, libc::REG_R10, libc::REG_R8, libc::REG_R9];
    order.map(|register| context.uc_mcontext.gregs[register as usize] as usize)
}

/// Sets what the interrupted system call returns.
pub fn set_result(context: &mut libc::ucontext_t, result: isize) {
    context.uc_mcontext.gregs[libc::REG_RAX as usize] = result as i64;
}

/// General registers and flags, for the evidence of a trap.
#[must_use]
pub fn registers(context: &libc::ucontext_t) -> Registers {
    let order = [
        libc::REG_RAX,
        libc::REG_RBX,
        libc::REG_RCX,
        libc::REG_RDX,
        libc::REG_RSI,
        libc::REG_RDI,
        libc::REG_RBP,
        libc::REG_R8,
        libc::REG_R9,
        libc::REG_R10,
        libc::REG_R11,
        libc::REG_R12,
        libc::REG_R13,
        libc::REG_R14,
        libc::REG_R15,
        libc::REG_EFL,
    ];
    Registers::new(order.map(|register| context.uc_mcontext.gregs[register as usize] as u64))
}

/// The return address that a register holds: here it is on the stack.
#[must_use]
pub const fn link(_: &libc::ucontext_t) -> Option<u64> {
    None
}
