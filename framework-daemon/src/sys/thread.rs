//! Threads that may run fibers: an alternate signal stack, and the scheduling that the profile asks for.
#![allow(unsafe_code, reason = "address of unsafe: signal stacks and scheduling system calls")]

use std::thread::JoinHandle;

use super::heap;
use crate::model::limits::SIGNAL_STACK_BYTES;
use crate::model::schedule::{Policy, Schedule};

/// An alternate signal stack for this thread: the handler of a stack overflow needs one.
#[derive(Debug)]
pub struct SignalStack(#[allow(dead_code, reason = "held for the kernel")] Box<[u8]>);

impl SignalStack {
    /// Installs one for the calling thread.
    #[must_use]
    pub fn new() -> Self {
        // Written once, so that the first fault need not wait for pages.
        Self::of(vec![1u8; SIGNAL_STACK_BYTES].into_boxed_slice())
    }

    /// As [`Self::new`], for a thread in no hurry: the stack of one that is lost takes what its handler touched.
    #[must_use]
    pub fn untouched() -> Self {
        Self::of(vec![0u8; SIGNAL_STACK_BYTES].into_boxed_slice())
    }

    fn of(mut memory: Box<[u8]>) -> Self {
        let stack = libc::stack_t { ss_sp: memory.as_mut_ptr().cast(), ss_flags: 0, ss_size: memory.len() };
        // SAFETY: the memory is held until `drop` takes it from the kernel; the old stack is not asked for.
        unsafe { libc::sigaltstack(&raw const stack, std::ptr::null_mut()) };
        Self(memory)
    }
}

impl Drop for SignalStack {
    fn drop(&mut self) {
        let none = libc::stack_t { ss_sp: std::ptr::null_mut(), ss_flags: libc::SS_DISABLE, ss_size: 0 };
        // SAFETY: no handler runs on it now, because this code does; afterwards the kernel knows it no more.
        unsafe { libc::sigaltstack(&raw const none, std::ptr::null_mut()) };
    }
}

impl Default for SignalStack {
    fn default() -> Self {
        Self::new()
    }
}

/// The calling thread as the kernel knows it.
#[must_use]
pub fn id() -> i32 {
    // SAFETY: the system call takes no memory.
    unsafe { libc::gettid() }
}

/// Starts a thread that runs no fibers. A signal that ends the process may strike it all the same, and the last words need
/// more room than the standard library's signal stacks have.
///
/// # Errors
/// When the system has no thread left.
pub fn spawn(name: &str, body: impl FnOnce() + Send + 'static) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name(name.to_owned()).spawn(move || {
        let _stack = SignalStack::new();
        body();
    })
}

/// The calling thread goes before all others of ordinary scheduling, where the system permits it (`CAP_SYS_NICE`); before no
/// real-time one. For work that is short, rare and waited for.
pub fn hurry() {
    const FIRST: i32 = -20;
    // SAFETY: the system call takes no memory; 0 is the calling thread.
    unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, FIRST) };
}

/// Starts a thread that may run fibers. What the system does not permit of `schedule` is passed to `refused`, in words.
///
/// # Errors
/// When the system has no thread left.
pub fn spawn_guarded(
    name: &str,
    schedule: Schedule,
    refused: impl FnOnce(&str) + Send + 'static,
    body: impl FnOnce() + Send + 'static,
) -> std::io::Result<JoinHandle<()>> {
    std::thread::Builder::new().name(name.chars().take(15).collect()).spawn(move || {
        let _stack = SignalStack::new();
        heap::adopt_thread();
        // Without it every timed wait is up to 50 us late.
        let _ = nix::sys::prctl::set_timerslack(1);
        if let Err(reason) = apply(&schedule) {
            refused(&reason);
        }
        body();
    })
}

/// Applies policy, priority and affinity to the calling thread.
fn apply(schedule: &Schedule) -> Result<(), String> {
    pin(&schedule.cpus)?;
    let (policy, name) = match schedule.policy {
        Policy::Other => return Ok(()),
        Policy::Fifo => (libc::SCHED_FIFO, "SCHED_FIFO"),
        Policy::RoundRobin => (libc::SCHED_RR, "SCHED_RR"),
    };
    let priority = schedule.priority.clamp(1, 99);
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: the parameters are initialised; 0 is the calling thread.
    if unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) } == 0 {
        return Ok(());
    }
    Err(format!(
        "{name} priority {priority} is not permitted ({}): runs under SCHED_OTHER; \
         grant CAP_SYS_NICE or raise `ulimit -r` to {priority}",
        std::io::Error::last_os_error()
    ))
}

fn pin(cpus: &[usize]) -> Result<(), String> {
    if cpus.is_empty() {
        return Ok(());
    }
    let mut set = nix::sched::CpuSet::new();
    let result = cpus
        .iter()
        .try_for_each(|cpu| set.set(*cpu))
        .and_then(|()| nix::sched::sched_setaffinity(nix::unistd::Pid::from_raw(0), &set));
    result.map_err(|error| format!("processors {cpus:?} cannot be used ({error}): runs on any processor"))
}
