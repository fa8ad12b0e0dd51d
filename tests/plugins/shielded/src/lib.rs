//! A component that reaches for the process that it runs in: its handlers, its masks, its end, its threads.
#![allow(unsafe_code, reason = "faults on purpose")]

use std::os::unix::process::CommandExt;
use std::process::Command;

use component_sdk::prelude::*;

/// On its own thread: what would end the process.
mod astray;

/// What no level contains.
mod beyond;

/// Descriptors of others.
mod descriptors;

/// What a process may do all the same.
mod lawful;

/// System calls past the C library.
mod raw;

/// Does one deed in each third `on_execute`, and says so when it is over.
#[derive(Component)]
#[component(name = "Shielded", version = "1.0", periodic = "5ms")]
pub struct Shielded {
    /// Which one.
    #[property(default = "nothing")]
    deed: String,
    cycles: u64,
}

impl Callbacks for Shielded {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        self.cycles += 1;
        // To print where both panics were takes long: one thread at a time does that.
        let is_slow = self.deed == "thread double panic";
        if self.cycles == 3 || self.cycles.is_multiple_of(3) && !is_slow {
            commit(&self.deed, cx)?;
            info!(cx, "is over: {}", self.deed);
        }
        Ok(())
    }
}

fn commit(deed: &str, cx: &Context<'_>) -> Outcome {
    match deed {
        "handler reset" => reset_handlers(),
        "mask" => mask_all(),
        "signal stack" => disable_signal_stack(),
        "destructors" => leave_destructors(),
        // SAFETY: a signal to this process.
        "kill" => _ = unsafe { libc::kill(libc::getpid(), libc::SIGTERM) },
        // SAFETY: as above.
        "kill hard" => _ = unsafe { libc::kill(0, libc::SIGKILL) },
        // SAFETY: as above.
        "kill group" => _ = unsafe { libc::killpg(0, libc::SIGINT) },
        // SAFETY: as above.
        "raise" => _ = unsafe { libc::raise(libc::SIGTERM) },
        // SAFETY: as above.
        "raise segv" => _ = unsafe { libc::raise(libc::SIGSEGV) },
        // SAFETY: a signal to this thread.
        "pthread_kill" => _ = unsafe { libc::pthread_kill(libc::pthread_self(), libc::SIGKILL) },
        "exec" => return Err(Command::new("true").exec().into()),
        // SAFETY: none; the thread is not this component's.
        "pthread_exit" => unsafe { libc::pthread_exit(std::ptr::null_mut()) },
        "exit" => std::process::exit(0),
        // SAFETY: as above.
        "exit now" => unsafe { libc::_exit(0) },
        _ => return elsewhere(deed, cx),
    }
    Ok(())
}

fn elsewhere(deed: &str, cx: &Context<'_>) -> Outcome {
    let known = raw::commit(deed).or_else(|()| lawful::commit(deed)).or_else(|()| descriptors::commit(deed));
    let known = known.or_else(|()| beyond::commit(deed, cx));
    known.unwrap_or_else(|()| astray::commit(deed))
}

/// Fails when its thread ends.
struct Ending;

impl Drop for Ending {
    fn drop(&mut self) {
        null_write();
    }
}

thread_local! {
    static ENDING: Ending = const { Ending };
}

/// Leaves behind what fails at the end of the thread, and of the process.
fn leave_destructors() {
    extern "C" fn fail() {
        null_write();
    }
    ENDING.with(|_| ());
    // SAFETY: a function that takes nothing.
    unsafe { libc::atexit(fail) };
}

fn null_write() {
    // SAFETY: none; the write faults, which is its purpose.
    unsafe { std::hint::black_box(16 as *mut u32).write_volatile(1) };
}

#[allow(unconditional_recursion, reason = "the stack is to overflow")]
fn overflow(depth: u64) -> u64 {
    let frame = std::hint::black_box([depth; 64]);
    overflow(depth + 1) + frame[(depth % 64) as usize]
}

const FATAL: [i32; 7] =
    [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGABRT, libc::SIGSYS, libc::SIGTRAP];

fn reset_handlers() {
    for signal in FATAL {
        // SAFETY: an all-zero action is valid: the default.
        unsafe {
            libc::signal(signal, libc::SIG_DFL);
            let action: libc::sigaction = std::mem::zeroed();
            libc::sigaction(signal, &raw const action, std::ptr::null_mut());
        }
    }
    null_write();
}

fn mask_all() {
    // SAFETY: an all-zero set is valid, and the calls read and write this one only.
    unsafe {
        let mut set: libc::sigset_t = std::mem::zeroed();
        libc::sigfillset(&raw mut set);
        libc::pthread_sigmask(libc::SIG_BLOCK, &raw const set, std::ptr::null_mut());
        libc::sigprocmask(libc::SIG_SETMASK, &raw const set, std::ptr::null_mut());
    }
    null_write();
}

fn disable_signal_stack() {
    let none = libc::stack_t { ss_sp: std::ptr::null_mut(), ss_flags: libc::SS_DISABLE, ss_size: 0 };
    // SAFETY: takes the stack away, which is its purpose.
    unsafe { libc::sigaltstack(&raw const none, std::ptr::null_mut()) };
    std::hint::black_box(overflow(1));
}

export_components!(Shielded);
