//! Calls the command line and turns its outcome into an exit code.

use framework_daemon::cli::{self, Exit};
use framework_daemon::sys::arch;
use framework_daemon::sys::thread::SignalStack;

/// The daemon's own: a component that dies inside the C library's `malloc` takes that one's locks with it.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// As much as the main thread has.
const STACK_BYTES: usize = 8 << 20;

/// All runs on another thread than the main one, so that nothing depends on the C library's main arena
/// (`framework_daemon::sys::heap`).
///
/// It ends without what the C library would still run: components' libraries have destructors, too, and all that is to be said
/// at the end has been said.
fn main() {
    // Signals from outside come to the main thread first, and plugins' handlers run here if they can.
    let _stack = SignalStack::new();
    let daemon = std::thread::Builder::new().name("daemon".into()).stack_size(STACK_BYTES);
    let ended = daemon.spawn(|| arch::exit_process(cli::main() as u8)).map(std::thread::JoinHandle::join);
    // It panicked, or there is no such thread.
    drop(ended);
    arch::exit_process(Exit::Failed as u8)
}
