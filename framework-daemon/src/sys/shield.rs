//! The end of the process as plugins see it: `abort`, `exit`, `_exit`, `_Exit`, `quick_exit` are ours, because the executable
//! comes first in symbol resolution. On a fiber they end the fiber; anywhere else they do what they always did.
//!
//! glibc's own `abort` holds a lock while it raises SIGABRT. A fiber that is ended inside it leaves that lock to its thread,
//! and the next abort of another component, on another thread, would wait for ever.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use std::ffi::CStr;

use super::trap;

/// SIGABRT without glibc's lock: the trap handler ends the fiber, or elsewhere says the process's last words and ends it.
#[unsafe(no_mangle)]
pub extern "C" fn abort() -> ! {
    trap::raise_abort();
    real(c"_exit", 134)
}

/// `exit` of a component is a fault of it (`crash.exit`), not the end of the daemon.
#[unsafe(no_mangle)]
pub extern "C" fn exit(code: i32) -> ! {
    leave(c"exit", code)
}

/// As [`exit`].
#[unsafe(no_mangle)]
pub extern "C" fn _exit(code: i32) -> ! {
    leave(c"_exit", code)
}

/// As [`exit`].
#[unsafe(no_mangle)]
pub extern "C" fn _Exit(code: i32) -> ! {
    leave(c"_Exit", code)
}

/// As [`exit`].
#[unsafe(no_mangle)]
pub extern "C" fn quick_exit(code: i32) -> ! {
    leave(c"quick_exit", code)
}

fn leave(name: &CStr, code: i32) -> ! {
    if trap::on_fiber() {
        trap::raise_exit();
    }
    real(name, code)
}

/// The C library's function of that name.
fn real(name: &CStr, code: i32) -> ! {
    // SAFETY: the next definition behind ours is the C library's, which every process has and which takes an `int` and
    // does not return. The system call below is what remains if it were missing.
    unsafe {
        let found = libc::dlsym(libc::RTLD_NEXT, name.as_ptr());
        if !found.is_null() {
            std::mem::transmute::<*mut libc::c_void, extern "C" fn(i32) -> !>(found)(code);
        }
        loop {
            libc::syscall(libc::SYS_exit_group, code);
        }
    }
}
