//! `abort` as plugins see it: ours, because the executable comes first in symbol resolution.
//!
//! glibc's own holds a lock while it raises SIGABRT. A fiber that is ended inside it leaves that lock to its thread, and the
//! next abort of another component, on another thread, would wait for ever. (`exit` and kin follow here.)
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use super::trap;

/// On a fiber: SIGABRT without glibc's lock, so that the trap handler ends the fiber. Elsewhere: the end of the process.
#[unsafe(no_mangle)]
pub extern "C" fn abort() -> ! {
    // SAFETY: system calls without memory operands; both directed at this thread and process.
    unsafe {
        if trap::on_fiber() {
            libc::syscall(libc::SYS_tgkill, libc::getpid(), libc::gettid(), libc::SIGABRT);
        }
        libc::signal(libc::SIGABRT, libc::SIG_DFL);
        libc::syscall(libc::SYS_tgkill, libc::getpid(), libc::gettid(), libc::SIGABRT);
        // Blocked or ignored: there is no other way left.
        libc::_exit(134)
    }
}
