//! All that depends on the processor: one small file each, with the same functions.
//!
//! x86-64 is proven by the tests. The functions for aarch64 are compiled and read, not run: what they rest on is the
//! architecture's register names in the signal frame and `corosensei`'s own trap handler, which its authors test there.
#![allow(unsafe_code, reason = "address of unsafe: a thread that ends itself")]

#[cfg(target_arch = "x86_64")]
#[path = "x86_64.rs"]
mod processor;

#[cfg(target_arch = "aarch64")]
#[path = "aarch64.rs"]
mod processor;

pub use processor::{
    AUDIT_ARCH, OVERWRITES, allow_unaligned, arguments, continue_at, fetch_line, link, position, registers,
    restore_float_control, resume, return_address, set_result, strike, system_call, waits,
};

/// In a signal handler that does not return: lets the signals through again that it holds back.
pub fn let_through(context: &libc::ucontext_t) {
    let mask = (&raw const context.uc_sigmask).addr();
    // SAFETY: the kernel reads its own set of signals, and changes nothing else than this thread's.
    unsafe { system_call(libc::SYS_rt_sigprocmask, [libc::SIG_SETMASK as usize, mask, 0, KERNEL_SET_BYTES, 0, 0]) };
}

/// The kernel's set of signals is smaller than the C library's.
const KERNEL_SET_BYTES: usize = 8;

/// Fetches memory to this processor, to be written to. Whatever the address is, nothing traps.
pub fn bring_near(address: usize, bytes: usize) {
    (address..address + bytes).step_by(64).for_each(fetch_line);
}

/// Ends this kernel thread here and now: nothing is unwound, freed or run. The kernel walks its list of robust locks and
/// wakes whoever joins it.
pub fn exit_thread() -> ! {
    loop {
        // SAFETY: takes no memory, and does not return.
        unsafe { system_call(libc::SYS_exit, [0; 6]) };
    }
}

/// Ends the process here and now: nothing is unwound, freed or run, and nothing that was registered for the end of a process.
pub fn exit_process(code: u8) -> ! {
    loop {
        // SAFETY: takes no memory, and does not return.
        unsafe { system_call(libc::SYS_exit_group, [usize::from(code), 0, 0, 0, 0, 0]) };
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_system_call_returns_what_the_kernel_says() {
        // SAFETY: neither takes memory, and there is no such descriptor.
        let (pid, close) = unsafe {
            (super::system_call(libc::SYS_getpid, [0; 6]), super::system_call(libc::SYS_close, [usize::MAX; 6]))
        };
        assert_eq!((pid, close), (std::process::id() as isize, -(libc::EBADF as isize)));
    }
}
