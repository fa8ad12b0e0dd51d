//! The end of the process, signal handlers, signal masks: by the C library's functions and by raw system calls.

use super::memory::write;

torture! {
    /// Aborts.
    Abort => || std::process::abort();

    /// Ends the process, as it thinks.
    Exit => || {
        // SAFETY: takes no memory.
        unsafe { libc::exit(3) }
    };

    /// Ends the process by its standard library, as it thinks.
    RustExit => || std::process::exit(3);

    /// Ends the process at once, as it thinks.
    UnderscoreExit => || {
        // SAFETY: takes no memory.
        unsafe { libc::_exit(3) }
    };

    /// Ends the process quickly, as it thinks.
    QuickExit => || {
        // SAFETY: takes no memory.
        unsafe { quick_exit(3) }
    };

    /// Resets the handlers of all fatal signals, then faults.
    HandlerReset => || {
        // SAFETY: takes no memory.
        FATAL.iter().for_each(|signal| _ = unsafe { libc::signal(*signal, libc::SIG_DFL) });
        write(24);
    };

    /// Masks all signals, then faults: the kernel ends a process that faults with the signal masked.
    SignalMask => || {
        // SAFETY: `sigfillset` initialises the set.
        unsafe {
            let mut all: libc::sigset_t = std::mem::zeroed();
            libc::sigfillset(&raw mut all);
            libc::pthread_sigmask(libc::SIG_SETMASK, &raw const all, std::ptr::null_mut());
            libc::sigprocmask(libc::SIG_SETMASK, &raw const all, std::ptr::null_mut());
        }
        write(24);
    };

    /// Ends the process by a system call.
    RawExit => || {
        // SAFETY: takes no memory.
        unsafe { libc::syscall(libc::SYS_exit_group, 3) };
    };

    /// Resets the handler of SIGSEGV by a system call, then faults.
    RawHandlerReset => || {
        let default = [0u64; 4];
        // SAFETY: the kernel reads a struct of four words; all zero is the default action.
        unsafe { libc::syscall(libc::SYS_rt_sigaction, libc::SIGSEGV, default.as_ptr(), std::ptr::null::<u64>(), 8) };
        write(24);
    };

    /// Masks all signals by a system call, then faults.
    RawSignalMask => || {
        let all = u64::MAX;
        // SAFETY: the kernel reads a set of eight bytes.
        unsafe { libc::syscall(libc::SYS_rt_sigprocmask, libc::SIG_SETMASK, &raw const all, std::ptr::null::<u64>(), 8) };
        write(24);
    };

    /// Kills the process by a system call.
    RawKill => || {
        // SAFETY: takes no memory.
        unsafe { libc::syscall(libc::SYS_kill, libc::getpid(), libc::SIGKILL) };
    };
}

const FATAL: [i32; 5] = [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGABRT];

unsafe extern "C" {
    fn quick_exit(code: i32) -> !;
}
