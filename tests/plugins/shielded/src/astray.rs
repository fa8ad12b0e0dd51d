//! On a thread of its own: what would end the process ends that thread and is a fault of the slot.

use std::thread;

use component_sdk::prelude::*;

use crate::{mask_all, null_write, overflow, reset_handlers};

/// Starts a thread and does not wait for it.
pub(crate) fn commit(deed: &str) -> Outcome {
    let body: fn() = match deed {
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
