//! x86-64.
#![allow(unsafe_code, reason = "address of unsafe: system calls from the daemon's own text")]

/// As the kernel names this processor to a filter of system calls.
pub(in crate::sys) const AUDIT_ARCH: u32 = 0xC000_003E;

/// A system call from the daemon's own text, where no fence stands.
///
/// # Safety
/// The arguments must be what that call may be given.
pub(in crate::sys) unsafe fn system_call(number: i64, arguments: [usize; 6]) -> isize {
    let mut result = number as isize;
    let [a, b, c, d, e, f] = arguments;
    // SAFETY: the registers are those of the kernel's convention; it changes rcx and r11 only, and memory.
    unsafe {
        std::arch::asm!("syscall", inlateout("rax") result, in("rdi") a, in("rsi") b, in("rdx") c, in("r10") d,
            in("r8") e, in("r9") f, out("rcx") _, out("r11") _, options(nostack));
    }
    result
}

/// What the interrupted system call was given.
pub(in crate::sys) fn arguments(context: &libc::ucontext_t) -> [usize; 6] {
    let order = [libc::REG_RDI, libc::REG_RSI, libc::REG_RDX, libc::REG_R10, libc::REG_R8, libc::REG_R9];
    order.map(|register| context.uc_mcontext.gregs[register as usize] as usize)
}

/// Sets what the interrupted system call returns.
pub(in crate::sys) fn set_result(context: &mut libc::ucontext_t, result: isize) {
    context.uc_mcontext.gregs[libc::REG_RAX as usize] = result as i64;
}
