//! aarch64.

use crate::model::fault::Registers;

/// General registers and flags at a trap.
pub(in crate::sys) fn registers(context: &libc::ucontext_t) -> Registers {
    let mut values = [0; 32];
    values[..31].copy_from_slice(&context.uc_mcontext.regs);
    values[31] = context.uc_mcontext.pstate;
    Registers::new(values)
}

/// The return address that a register holds, until the function calls another.
pub(in crate::sys) const fn link(context: &libc::ucontext_t) -> Option<u64> {
    Some(context.uc_mcontext.regs[30])
}
