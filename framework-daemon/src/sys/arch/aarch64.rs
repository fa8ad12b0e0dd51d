//! aarch64.
#![allow(unsafe_code, reason = "address of unsafe: system calls from the daemon's own text")]

/// As the kernel names this processor to a filter of system calls.
pub(in crate::sys) const AUDIT_ARCH: u32 = 0xC000_00B7;

/// A system call from the daemon's own text, where no fence stands.
///
/// # Safety
/// The arguments must be what that call may be given.
pub(in crate::sys) unsafe fn system_call(number: i64, arguments: [usize; 6]) -> isize {
    let [a, b, c, d, e, f] = arguments;
    let mut result = a as isize;
    // SAFETY: the registers are those of the kernel's convention; it changes none but the result, and memory.
    unsafe {
        std::arch::asm!("svc 0", in("x8") number, inlateout("x0") result, in("x1") b, in("x2") c, in("x3") d,
            in("x4") e, in("x5") f, options(nostack));
    }
    result
}

/// What the interrupted system call was given.
pub(in crate::sys) fn arguments(context: &libc::ucontext_t) -> [usize; 6] {
    std::array::from_fn(|register| context.uc_mcontext.regs[register] as usize)
}

/// Sets what the interrupted system call returns.
pub(in crate::sys) fn set_result(context: &mut libc::ucontext_t, result: isize) {
    context.uc_mcontext.regs[0] = result as u64;
}
