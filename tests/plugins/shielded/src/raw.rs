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
