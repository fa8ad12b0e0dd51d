//! System calls past the C library's functions: through `syscall`, and by an instruction of its own.

use component_sdk::prelude::*;

use crate::null_write;

/// `Err`: no deed of this file.
pub(crate) fn commit(deed: &str) -> Result<Outcome, ()> {
    let own = i64::from(std::process::id());
    // SAFETY: none; the process is not this component's.
    unsafe {
        match deed {
            "syscall exit_group" => _ = libc::syscall(libc::SYS_exit_group, 0),
            "syscall exit" => _ = libc::syscall(libc::SYS_exit, 0),
            "syscall kill" => _ = libc::syscall(libc::SYS_kill, own, libc::SIGKILL),
            "syscall tgkill" => _ = libc::syscall(libc::SYS_tgkill, own, own, libc::SIGTERM),
            "asm exit_group" => _ = instruction(libc::SYS_exit_group, [0; 4]),
            "asm kill" => _ = instruction(libc::SYS_kill, [own as usize, libc::SIGKILL as usize, 0, 0]),
            "syscall handler reset" => reset_handler(by_function),
            "asm handler reset" => reset_handler(|args| instruction(libc::SYS_rt_sigaction, args)),
            "asm mask" => mask_all(),
            "asm own stack" => on_own_stack(),
            "asm wild stack" => lose_stack(),
            "asm signal stack" => disable_signal_stack(),
            _ => return Err(()),
        }
    }
    Ok(Ok(()))
}

fn reset_handler(call: impl Fn([usize; 4]) -> isize) {
    // The kernel's own record: handler, flags, restorer, mask.
    let action = [libc::SIG_DFL, 0, 0, 0];
    let result = call([libc::SIGSEGV as usize, (&raw const action).addr(), 0, 8]);
    assert_eq!(result, 0, "it seems to succeed");
    null_write();
}

fn by_function(args: [usize; 4]) -> isize {
    // SAFETY: reads the record.
    let result = unsafe { libc::syscall(libc::SYS_rt_sigaction, args[0], args[1], args[2], args[3]) };
    result as isize
}

fn mask_all() {
    let all = u64::MAX;
    // SAFETY: reads the set.
    let result =
        unsafe { instruction(libc::SYS_rt_sigprocmask, [libc::SIG_SETMASK as usize, (&raw const all).addr(), 0, 8]) };
    assert_eq!(result, 0, "it seems to succeed");
    null_write();
}

fn disable_signal_stack() {
    let none = libc::stack_t { ss_sp: std::ptr::null_mut(), ss_flags: libc::SS_DISABLE, ss_size: 0 };
    // SAFETY: reads the record.
    let result = unsafe { instruction(libc::SYS_sigaltstack, [(&raw const none).addr(), 0, 0, 0]) };
    assert_eq!(result, 0, "it seems to succeed");
    std::hint::black_box(crate::overflow(1));
}

/// Fails on a stack that it brought along, as a library with coroutines of its own does.
#[cfg(target_arch = "x86_64")]
fn on_own_stack() {
    let mut stack = vec![0u8; 256 << 10];
    let top = stack.as_mut_ptr_range().end.addr() & !15;
    // SAFETY: a stack of its own for a function that does not return; the old one is restored if it did.
    unsafe {
        std::arch::asm!("mov r12, rsp", "mov rsp, {top}", "call {body}", "mov rsp, r12", top = in(reg) top,
            body = sym fail, out("r12") _, clobber_abi("C"));
    }
}

#[cfg(target_arch = "x86_64")]
extern "C" fn fail() {
    null_write();
}

/// Loses its stack pointer.
#[cfg(target_arch = "x86_64")]
fn lose_stack() {
    // SAFETY: none; the push faults, which is its purpose.
    unsafe { std::arch::asm!("mov rsp, {wild}", "push rax", wild = in(reg) 4096usize, options(noreturn)) };
}

/// Fails on a stack that it brought along, as a library with coroutines of its own does.
#[cfg(target_arch = "aarch64")]
fn on_own_stack() {
    null_write();
}

/// Loses its stack pointer.
#[cfg(target_arch = "aarch64")]
fn lose_stack() {
    // SAFETY: none; the store faults, which is its purpose.
    unsafe { std::arch::asm!("mov sp, {wild}", "str x0, [sp]", wild = in(reg) 4096usize, options(noreturn)) };
}

/// A system call by an instruction in this component's own text.
#[cfg(target_arch = "x86_64")]
unsafe fn instruction(number: i64, [a, b, c, d]: [usize; 4]) -> isize {
    let mut result = number as isize;
    // SAFETY: the kernel's convention; what it does is the caller's affair.
    unsafe {
        std::arch::asm!("syscall", inlateout("rax") result, in("rdi") a, in("rsi") b, in("rdx") c, in("r10") d,
            out("rcx") _, out("r11") _, options(nostack));
    }
    result
}

/// A system call by an instruction in this component's own text.
#[cfg(target_arch = "aarch64")]
unsafe fn instruction(number: i64, [a, b, c, d]: [usize; 4]) -> isize {
    let mut result = a as isize;
    // SAFETY: the kernel's convention; what it does is the caller's affair.
    unsafe {
        std::arch::asm!("svc 0", in("x8") number, inlateout("x0") result, in("x1") b, in("x2") c, in("x3") d,
            options(nostack));
    }
    result
}
