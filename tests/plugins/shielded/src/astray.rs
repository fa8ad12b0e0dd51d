//! On a thread of its own, and in signal handlers of its own: what would end the process ends that thread or handler and is
//! a fault of the slot.

use std::thread;

use component_sdk::prelude::*;

use crate::{mask_all, null_write, overflow, reset_handlers};

/// Starts a thread and does not wait for it, or signals itself.
pub(crate) fn commit(deed: &str) -> Outcome {
    let body: fn() = match deed {
        "own handler null" => return handle_by(null_handler, libc::raise),
        "own handler abort" => return handle_by(abort_handler, libc::raise),
        "own handler exit" => return handle_by(exit_handler, libc::raise),
        "own handler null elsewhere" => return handle_by(null_handler, signal_process),
        "thread null" => null_write,
        "thread panic" => || panic!("astray"),
        "thread double panic" => double_panic,
        "thread overflow" => || _ = std::hint::black_box(overflow(1)),
        "thread abort" => || std::process::abort(),
        "thread exit" => || std::process::exit(0),
        // SAFETY: none; the process is not this component's.
        "thread exit now" => || unsafe { libc::_exit(0) },
        // SAFETY: as above.
        "thread syscall exit_group" => || _ = unsafe { libc::syscall(libc::SYS_exit_group, 0) },
        // SAFETY: as above.
        "thread kill" => || _ = unsafe { libc::kill(libc::getpid(), libc::SIGKILL) },
        "thread handler reset" => reset_handlers,
        "thread mask" => mask_all,
        "grandchild null" => || drop(thread::spawn(null_write)),
        _ => return Err(fault!("no such deed: {deed}")),
    };
    drop(thread::Builder::new().spawn(body)?);
    Ok(())
}

extern "C" fn null_handler(_: i32) {
    null_write();
}

extern "C" fn abort_handler(_: i32) {
    std::process::abort();
}

extern "C" fn exit_handler(_: i32) {
    // SAFETY: none; the process is not this component's.
    unsafe { libc::_exit(0) };
}

/// The kernel calls the handler on a thread that it chooses, the main thread if it can.
unsafe extern "C" fn signal_process(signal: i32) -> i32 {
    // SAFETY: a signal that somebody handles.
    unsafe { libc::kill(libc::getpid(), signal) }
}

fn handle_by(handler: extern "C" fn(i32), send: unsafe extern "C" fn(i32) -> i32) -> Outcome {
    // SAFETY: what the handler does is the purpose.
    let sent = unsafe {
        libc::signal(libc::SIGUSR2, handler as libc::sighandler_t);
        send(libc::SIGUSR2)
    };
    if sent == 0 { Ok(()) } else { Err(fault!("the signal was not sent")) }
}

struct Bomb;

impl Drop for Bomb {
    fn drop(&mut self) {
        panic!("in a drop");
    }
}

fn double_panic() {
    let _bomb = Bomb;
    panic!("astray");
}
