//! On a thread of its own, and in signal handlers of its own: what would end the process ends that thread or handler and is
//! a fault of the slot.

use std::sync::atomic::{AtomicI32, Ordering};
use std::thread;
use std::time::Duration;

use component_sdk::component::ComponentError;
use component_sdk::prelude::*;

use crate::{mask_all, null_write, overflow, reset_handlers};

/// Starts a thread and does not wait for it, or signals itself.
pub(crate) fn commit(deed: &str) -> Outcome {
    let body: fn() = match deed {
        "clone null" => return clone_thread(null_body),
        "clone exit" => return clone_thread(exit_body),
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

extern "C" fn null_body(_: *mut libc::c_void) -> i32 {
    null_write();
    0
}

extern "C" fn exit_body(_: *mut libc::c_void) -> i32 {
    // SAFETY: ends this kernel thread.
    unsafe { libc::syscall(libc::SYS_exit, 0) as i32 }
}

/// Of a kernel thread of this process.
pub(crate) const THREAD: i32 = libc::CLONE_VM
    | libc::CLONE_FS
    | libc::CLONE_FILES
    | libc::CLONE_SIGHAND
    | libc::CLONE_THREAD
    | libc::CLONE_SYSVSEM
    | libc::CLONE_CHILD_CLEARTID;

/// Starts what the C library does not know; returns its number.
pub(crate) fn start_clone(
    body: extern "C" fn(*mut libc::c_void) -> i32,
    flags: i32,
    running: *mut i32,
) -> Result<i32, ComponentError> {
    let stack = Box::leak(vec![0u8; 64 << 10].into_boxed_slice());
    let (none, top) = (std::ptr::null_mut::<libc::c_void>(), stack.as_mut_ptr_range().end);
    // SAFETY: the stack is never freed, nor the word that the kernel clears, where there is one.
    let number = unsafe { libc::clone(body, top.cast(), flags, none, none, none, running) };
    if number > 0 { Ok(number) } else { Err(fault!("no thread: {}", std::io::Error::last_os_error())) }
}

/// A kernel thread that the C library does not know. The callback waits for its end.
fn clone_thread(body: extern "C" fn(*mut libc::c_void) -> i32) -> Outcome {
    let running = Box::leak(Box::new(AtomicI32::new(1)));
    start_clone(body, THREAD, running.as_ptr())?;
    while running.load(Ordering::Acquire) != 0 {
        thread::yield_now();
    }
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
        // Both are one fault, however long it takes from one to the other.
        thread::sleep(Duration::from_millis(100));
        panic!("in a drop");
    }
}

fn double_panic() {
    let _bomb = Bomb;
    panic!("astray");
}
