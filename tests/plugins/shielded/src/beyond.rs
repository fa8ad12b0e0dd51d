//! What no level contains: the lines of "What is left" in the README.

use std::cell::Cell;
use std::ffi::{c_int, c_void};
use std::fs::File;
use std::io::Write;
use std::ptr;
use std::sync::atomic::{AtomicBool, AtomicPtr, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::Duration;

use component_sdk::prelude::*;

use crate::astray::{THREAD, start_clone};
use crate::null_write;

/// More descriptors than the daemon has open.
const MANY: c_int = 256;

/// `Err`: no deed of this file.
pub(crate) fn commit(deed: &str, cx: &Context<'_>) -> Result<Outcome, ()> {
    match deed {
        "static lock" => fail_under_static_lock(),
        "stdio lock" => fail_under_lock_of_stdio(),
        "thread-local kept" => keep_thread_local(cx),
        "uninterruptible" => return Ok(wait_for_clone()),
        "clone null later" => return Ok(once(|| start_clone(late_null_body, THREAD, ptr::null_mut()).map(|_| ()))),
        "child that stays" => return Ok(once(leave_child)),
        "write everywhere" => return Ok(once(write_everywhere)),
        "own device" => return Ok(use_device()),
        "close others" => close_others(),
        "pidfd kill" => kill_by_pidfd(),
        "thread base" => move_thread_locals(),
        "own value" => look_at_own_value(cx),
        "wild write" => write_elsewhere(),
        _ => return Err(()),
    }
    Ok(Ok(()))
}

fn once(deed: impl FnOnce() -> Outcome) -> Outcome {
    static DONE: AtomicBool = AtomicBool::new(false);
    if DONE.swap(true, Ordering::Relaxed) { Ok(()) } else { deed() }
}

/// The lock outlives the instance that held it.
fn fail_under_static_lock() {
    static LOCK: Mutex<()> = Mutex::new(());
    let _held = LOCK.lock().unwrap_or_else(PoisonError::into_inner);
    null_write();
}

unsafe extern "C" {
    static stdout: *mut libc::FILE;
}

fn fail_under_lock_of_stdio() {
    // SAFETY: none; the C library copies from there, which faults while it holds the lock of that stream.
    unsafe { libc::fwrite(ptr::without_provenance(8), 1, 64, stdout) };
}

thread_local! {
    static OWN: Cell<u64> = const { Cell::new(7) };
}

/// Not kept by the compiler across a wait.
#[inline(never)]
fn own() -> *const Cell<u64> {
    OWN.with(ptr::from_ref)
}

fn keep_thread_local(cx: &Context<'_>) {
    let kept = own();
    let _ = cx.sleep(Duration::from_millis(200));
    // SAFETY: what is shown: the block of a thread that was given up stays.
    let value = unsafe { (*kept).get() };
    if ptr::eq(kept, own()) {
        return;
    }
    info!(cx, "its thread-local is elsewhere, and what it kept still says {value}");
}

/// Who starts a child that shares its memory this way is not to be interrupted before the child ends.
fn wait_for_clone() -> Outcome {
    start_clone(slow_body, libc::CLONE_VM | libc::CLONE_VFORK | libc::SIGCHLD, ptr::null_mut()).map(|_| ())
}

fn nap(time: libc::timespec) {
    // SAFETY: reads `time`; past the C library, of which this thread may have nothing of its own.
    unsafe { libc::syscall(libc::SYS_nanosleep, &raw const time, ptr::null_mut::<libc::timespec>()) };
}

extern "C" fn slow_body(_: *mut c_void) -> c_int {
    nap(libc::timespec { tv_sec: 3, tv_nsec: 0 });
    // SAFETY: ends this kernel thread.
    unsafe { libc::syscall(libc::SYS_exit, 0) as c_int }
}

extern "C" fn late_null_body(_: *mut c_void) -> c_int {
    nap(libc::timespec { tv_sec: 0, tv_nsec: 200_000_000 });
    null_write();
    0
}

/// A copy of the process, with all that it has open.
fn leave_child() -> Outcome {
    // SAFETY: the child calls nothing that may be locked.
    unsafe {
        match libc::fork() {
            0 => {
                nap(libc::timespec { tv_sec: 20, tv_nsec: 0 });
                libc::_exit(0)
            }
            -1 => Err(fault!("no child: {}", std::io::Error::last_os_error())),
            _ => Ok(()),
        }
    }
}

fn write_everywhere() -> Outcome {
    for fd in 3..MANY {
        // SAFETY: none; the descriptors are not this component's.
        unsafe { libc::write(fd, c"nonsense\n".as_ptr().cast(), 9) };
    }
    Ok(())
}

/// A device that is open for as long as the process.
fn use_device() -> Outcome {
    static DEVICE: OnceLock<File> = OnceLock::new();
    let device = DEVICE.get_or_init(|| File::options().write(true).open("/dev/null").expect("it is everywhere"));
    Ok((&*device).write_all(b"go")?)
}

fn close_others() {
    for fd in 3..MANY {
        // SAFETY: none; the descriptors are not this component's.
        unsafe { libc::close(fd) };
    }
}

fn kill_by_pidfd() {
    // SAFETY: takes no memory; a signal to this process.
    unsafe {
        let process = libc::syscall(libc::SYS_pidfd_open, libc::getpid(), 0);
        libc::syscall(libc::SYS_pidfd_send_signal, process, libc::SIGKILL, ptr::null_mut::<c_void>(), 0);
    }
}

/// From now on nobody on this thread finds its thread-locals.
fn move_thread_locals() {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: none; what runs on this thread next traps.
    unsafe {
        const ARCH_SET_FS: c_int = 0x1002;
        libc::syscall(libc::SYS_arch_prctl, ARCH_SET_FS, 0);
    }
}

static VALUE: AtomicPtr<u64> = AtomicPtr::new(ptr::null_mut());

fn look_at_own_value(cx: &Context<'_>) {
    let value = VALUE.load(Ordering::Acquire);
    if value.is_null() {
        VALUE.store(Box::leak(Box::new(7)), Ordering::Release);
        return;
    }
    // SAFETY: never freed.
    let value = unsafe { value.read_volatile() };
    info!(cx, "its own value is {value}");
}

/// It belongs to another slot's component.
fn write_elsewhere() {
    let value = VALUE.load(Ordering::Acquire);
    if !value.is_null() {
        // SAFETY: none; it is somebody else's.
        unsafe { value.write_volatile(8) };
    }
}
