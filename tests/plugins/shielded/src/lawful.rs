//! What a component may do, shield or not.

use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use component_sdk::prelude::*;

/// `Err`: no deed of this file.
pub(crate) fn commit(deed: &str) -> Result<Outcome, ()> {
    Ok(match deed {
        "child" => child(&mut Command::new("true")),
        "forked child" => forked_child(),
        "child that is not there" => absent_child(),
        "child that kills itself" => killed_child(),
        "child that comes back" => returning_child(),
        "alarm" => alarm(),
        "own handler" => own_handler(),
        "limits" => limits(),
        "filters" => filters(),
        "threads" => threads(),
        "thread that ends itself" => self_ended_thread(),
        _ => return Err(()),
    })
}

fn child(command: &mut Command) -> Outcome {
    let status = command.status()?;
    if status.success() { Ok(()) } else { Err(fault!("the child ended badly: {status}")) }
}

/// With something to do between `fork` and `exec`, the standard library forks.
fn forked_child() -> Outcome {
    let mut command = Command::new("true");
    // SAFETY: the closure does nothing.
    unsafe { command.pre_exec(|| Ok(())) };
    child(&mut command)
}

/// The copy of the process that cannot become another program ends by `_exit`.
fn absent_child() -> Outcome {
    let mut command = Command::new("/nowhere/to/be/found");
    // SAFETY: the closure does nothing.
    unsafe { command.pre_exec(|| Ok(())) };
    if command.status().is_err() { Ok(()) } else { Err(fault!("a child that is not there ran")) }
}

/// A trap in a copy of the process ends the copy.
fn killed_child() -> Outcome {
    let mut command = Command::new("true");
    // SAFETY: none; the copy is to end.
    unsafe {
        command.pre_exec(|| {
            crate::null_write();
            Ok(())
        });
    }
    let status = command.status()?;
    if status.signal() == Some(libc::SIGSEGV) {
        Ok(())
    } else {
        Err(fault!("the copy did not end by its trap: {status}"))
    }
}

/// A copy of the process that returns from its callback is no second daemon.
fn returning_child() -> Outcome {
    // SAFETY: the copy does nothing but return.
    let child = unsafe { libc::fork() };
    if child == 0 {
        return Ok(());
    }
    let mut status = -1;
    // SAFETY: the status outlives the call.
    let waited = unsafe { libc::waitpid(child, &raw mut status, 0) };
    if waited == child && status == 0 { Ok(()) } else { Err(fault!("the copy did not end: {waited} {status}")) }
}

/// A signal that ends a process that nobody prepared for it.
fn alarm() -> Outcome {
    // SAFETY: the default of a signal, and that signal.
    unsafe {
        libc::signal(libc::SIGALRM, libc::SIG_DFL);
        libc::raise(libc::SIGALRM);
        libc::raise(libc::SIGRTMIN());
    }
    Ok(())
}

static HEARD: AtomicBool = AtomicBool::new(false);

extern "C" fn hear(_: i32) {
    HEARD.store(true, Ordering::Release);
}

fn own_handler() -> Outcome {
    // SAFETY: the handler stores a flag.
    unsafe {
        libc::signal(libc::SIGUSR2, hear as extern "C" fn(i32) as libc::sighandler_t);
        libc::raise(libc::SIGUSR2);
    }
    if HEARD.load(Ordering::Acquire) { Ok(()) } else { Err(fault!("the handler was not called")) }
}

/// What would end the process within the second is not permitted.
fn limits() -> Outcome {
    let none = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: reads the limit.
    let results = unsafe {
        [
            libc::setrlimit(libc::RLIMIT_CPU, &raw const none).into(),
            libc::prlimit(0, libc::RLIMIT_CPU, &raw const none, std::ptr::null_mut()).into(),
            libc::syscall(libc::SYS_setrlimit, libc::RLIMIT_CPU, &raw const none),
            libc::syscall(libc::SYS_prlimit64, 0, libc::RLIMIT_CPU, &raw const none, 0),
        ]
    };
    if results == [-1_i64; 4] { Ok(()) } else { Err(fault!("limits were set: {results:?}")) }
}

/// A filter that would end the process with its next system call is not permitted.
fn filters() -> Outcome {
    let end = libc::sock_filter { code: 6, jt: 0, jf: 0, k: libc::SECCOMP_RET_KILL_PROCESS };
    let program = libc::sock_fprog { len: 1, filter: (&raw const end).cast_mut() };
    // SAFETY: reads the filter.
    let results = unsafe {
        [
            libc::prctl(libc::PR_SET_SECCOMP, 2, &raw const program, 0, 0) as i64,
            libc::syscall(libc::SYS_seccomp, libc::SECCOMP_SET_MODE_FILTER, 0, &raw const program),
        ]
    };
    if results == [-1; 2] { Ok(()) } else { Err(fault!("filters were set: {results:?}")) }
}

fn threads() -> Outcome {
    let sums: Vec<_> = (0..8u64).map(|each| thread::spawn(move || (0..each).sum::<u64>())).collect();
    let sum: u64 = sums.into_iter().filter_map(|sum| sum.join().ok()).sum();
    if sum == 56 { Ok(()) } else { Err(fault!("the threads' sum is {sum}")) }
}

/// A thread that ends by `pthread_exit` runs what it has to run.
fn self_ended_thread() -> Outcome {
    extern "C" fn body(_: *mut libc::c_void) -> *mut libc::c_void {
        std::ptr::null_mut()
    }
    // SAFETY: the thread is joined here, and neither takes nor gives memory.
    let result = unsafe {
        let mut thread = std::mem::zeroed();
        let made = libc::pthread_create(&raw mut thread, std::ptr::null(), body, std::ptr::null_mut());
        if made == 0 { libc::pthread_join(thread, std::ptr::null_mut()) } else { made }
    };
    if result == 0 { Ok(()) } else { Err(fault!("error {result}")) }
}
