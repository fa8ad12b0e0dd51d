//! Whether standard output was there when the process began. The standard library opens `/dev/null` for what is closed before
//! `main` runs, so that no file gets its number; afterwards nobody can tell whether somebody reads nothing on purpose. So it is
//! looked at before, where the loader calls what initialises a program.

#![allow(
    unsafe_code,
    reason = "address of unsafe: a function that runs before main asks the system for a descriptor's state"
)]

use std::sync::atomic::{AtomicBool, Ordering};

static WAS_CLOSED: AtomicBool = AtomicBool::new(false);

// SAFETY: what the loader finds in this section it calls as a function of the C ABI, which `look` is; arguments that it passes
// besides are left in their registers.
#[used]
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = look;

/// Runs before the standard library is ready: nothing of it is used but an atomic.
extern "C" fn look() {
    // SAFETY: asks for the flags of a descriptor by its number; nothing is read or written through a pointer.
    let flags = unsafe { libc::fcntl(libc::STDOUT_FILENO, libc::F_GETFD) };
    WAS_CLOSED.store(flags == -1, Ordering::Relaxed);
}

/// True where the process began without standard output.
#[must_use]
pub fn output_was_closed() -> bool {
    WAS_CLOSED.load(Ordering::Relaxed)
}
