//! x86-64.

use crate::model::fault::Registers;

/// General registers and flags at a trap.
pub(in crate::sys) fn registers(context: &libc::ucontext_t) -> Registers {
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
pub(in crate::sys) const fn link(_: &libc::ucontext_t) -> Option<u64> {
    None
}
