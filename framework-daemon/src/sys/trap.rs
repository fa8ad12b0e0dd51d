//! Fatal signals on a fiber end the fiber; anywhere else the previous handler decides.
//!
//! The handler asks first whether foreign code runs on this thread: a fiber is armed and the stack pointer lies in it.
//! It allocates nothing, takes no lock and calls nothing that is not async-signal-safe.
#![allow(unsafe_code, reason = "address of unsafe: signal handlers and register contexts")]

use std::cell::Cell;
use std::sync::Once;
use std::sync::atomic::{AtomicPtr, Ordering};

use corosensei::trap::CoroutineTrapHandler;

use super::fence::{self, Verdict};
use super::{clock, foreign, shield, text};
use crate::model::fault::TrapEvidence;

/// The signals that end a fiber.
pub const SIGNALS: [i32; 7] =
    [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGABRT, libc::SIGSYS, libc::SIGTRAP];

/// The signal that a watchdog sends to a thread whose callback is late.
#[must_use]
pub fn watchdog_signal() -> i32 {
    libc::SIGRTMAX() - 3
}

/// What the handler saw.
#[derive(Clone, Copy, Debug)]
pub struct Trap {
    /// Signal, address, registers.
    pub evidence: TrapEvidence,
    /// The access hit the guard page below the fiber's stack.
    pub stack_overflow: bool,
    /// The component called `exit` or one of its kin.
    pub exited: bool,
    /// When the handler was entered.
    pub at_ns: u64,
}

/// A fiber that runs on this thread: what the handler needs to end it.
#[derive(Clone, Copy)]
pub(super) struct Armed {
    handler: CoroutineTrapHandler<()>,
    stack_low: usize,
}

impl Armed {
    /// Of the fiber of that handler, with the lower end of its stack.
    pub(super) const fn new(handler: CoroutineTrapHandler<()>, stack_low: usize) -> Self {
        Self { handler, stack_low }
    }
}

thread_local! {
    // `const` and without destructor: the handler may read it at any moment.
    static ARMED: Cell<*const Armed> = const { Cell::new(std::ptr::null()) };
    static EXITING: Cell<bool> = const { Cell::new(false) };
    static TRAP: Cell<Option<Trap>> = const { Cell::new(None) };
}

/// Bytes above the lower end of a stack that count as its guard: one page.
const GUARD_BYTES: usize = 4096;

/// Says that the fiber runs on this thread from now on. Fibers do not nest.
pub(super) fn arm(fiber: &Armed) {
    ARMED.set(fiber);
}

/// Says that the fiber returned.
pub(super) fn disarm() {
    ARMED.set(std::ptr::null());
}

/// The trap that ended a fiber of this thread since the last call.
#[must_use]
pub fn take() -> Option<Trap> {
    TRAP.take()
}

/// True while plugin code runs on this thread.
#[must_use]
pub fn on_fiber() -> bool {
    !ARMED.get().is_null()
}

/// Sends SIGABRT to this thread; returns only where nobody handles it.
pub fn raise_abort() {
    // SAFETY: the set is initialised by `sigemptyset`; the system calls take no other memory and are directed at this
    // thread. It is unblocked first: a plugin may have masked it.
    unsafe {
        let mut set: libc::sigset_t = std::mem::zeroed();
        libc::sigemptyset(&raw mut set);
        libc::sigaddset(&raw mut set, libc::SIGABRT);
        libc::pthread_sigmask(libc::SIG_UNBLOCK, &raw const set, std::ptr::null_mut());
        libc::syscall(libc::SYS_tgkill, libc::getpid(), libc::gettid(), libc::SIGABRT);
    }
}

/// Ends the fiber of this thread because its component called `exit`.
pub fn raise_exit() {
    EXITING.set(true);
    raise_abort();
}

static PREVIOUS: [AtomicPtr<libc::sigaction>; SIGNALS.len()] =
    [const { AtomicPtr::new(std::ptr::null_mut()) }; SIGNALS.len()];

/// Takes the fatal signals over from whoever had them, once in a process.
pub fn install() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        text::install();
        for (index, signal) in SIGNALS.into_iter().enumerate() {
            install_one(index, signal);
        }
    });
}

fn install_one(index: usize, signal: i32) {
    // SAFETY: an all-zero `sigaction` is valid; `sigaction` reads the new and fills the old one; the handler has the
    // signature that SA_SIGINFO asks for. Leaking the old one keeps it valid for the handler for ever.
    unsafe {
        let mut new: libc::sigaction = std::mem::zeroed();
        new.sa_sigaction = handle as extern "C" fn(i32, *mut libc::siginfo_t, *mut libc::c_void) as usize;
        // No SA_NODEFER: a second trap of this kind inside the handler ends the process instead of recursing.
        new.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
        let old = Box::leak(Box::new(std::mem::zeroed::<libc::sigaction>()));
        libc::sigaction(signal, &raw const new, std::ptr::from_mut(old));
        PREVIOUS[index].store(old, Ordering::Release);
    }
}

extern "C" fn handle(signal: i32, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    let at_ns = clock::now_ns();
    // SAFETY: the kernel passes valid pointers for the time of the call (SA_SIGINFO).
    let (info, context) = unsafe { (&mut *info, &mut *context.cast::<libc::ucontext_t>()) };
    let (pc, sp) = registers::position(context);
    let verdict = fence::judge(info, context);
    if verdict == Some(Verdict::Answered) {
        return;
    }
    // SAFETY: a fiber is armed only while it runs, borrowed by this very thread.
    let armed = unsafe { ARMED.get().as_ref() };
    let sent = is_sent(info);
    // SAFETY: all of these signals but SIGABRT carry an address.
    let address = if signal == libc::SIGABRT { 0 } else { unsafe { info.si_addr() }.addr() };
    let mut trap = Trap {
        evidence: TrapEvidence { signal, address: address as u64, pc: pc as u64, sp: sp as u64 },
        stack_overflow: false,
        exited: EXITING.replace(false) || verdict == Some(Verdict::Leaves),
        at_ns,
    };
    let is_guest = sent != Some(false) && !shield::is_copy();
    let Some(armed) = armed.filter(|armed| armed.handler.stack_ptr_in_bounds(sp) && is_guest) else {
        if is_guest {
            foreign::struck(trap);
        }
        return if sent.is_some() { end_by(signal) } else { chain(signal, info, context) };
    };
    let guard = armed.stack_low..armed.stack_low + GUARD_BYTES;
    trap.stack_overflow = signal == libc::SIGSEGV && guard.contains(&address);
    TRAP.set(Some(trap));
    // SAFETY: the interrupted stack pointer lies in this fiber, which is alive: it is armed only while it runs. All
    // registers that the trap handler names are set, and the handler returns.
    unsafe { registers::redirect(context, &armed.handler.setup_trap_handler(|| ())) };
}

/// Some when the signal was sent and not caused by an instruction; true when this process sent it to itself (`abort`).
fn is_sent(info: &libc::siginfo_t) -> Option<bool> {
    // SAFETY: a signal that was sent carries its sender.
    (info.si_code <= 0).then(|| unsafe { info.si_pid() == libc::getpid() })
}

/// The process ends by this signal, as its supervisor expects. (The standard library's handler, to which a trap would be
/// handed on, expects the instruction to fault again; a signal that was sent does not.)
fn end_by(signal: i32) {
    // SAFETY: the default action is restored; the signal is blocked while its handler runs and ends the process when that
    // returns.
    unsafe {
        libc::signal(signal, libc::SIG_DFL);
        libc::raise(signal);
    }
}

/// Not ours: the previous handler's turn, or the default: the process ends by this signal.
fn chain(signal: i32, info: &mut libc::siginfo_t, context: &mut libc::ucontext_t) {
    let index = SIGNALS.iter().position(|known| *known == signal).unwrap_or(0);
    // SAFETY: `install_one` stored a leaked, initialised `sigaction` or nothing.
    let previous = unsafe { PREVIOUS[index].load(Ordering::Acquire).as_ref() };
    match previous {
        Some(old) if old.sa_sigaction > libc::SIG_IGN && old.sa_flags & libc::SA_SIGINFO != 0 => {
            // SAFETY: with SA_SIGINFO the field holds a function of this signature.
            let call: extern "C" fn(i32, *mut libc::siginfo_t, *mut libc::c_void) =
                unsafe { std::mem::transmute(old.sa_sigaction) };
            call(signal, info, std::ptr::from_mut(context).cast());
        }
        _ => end_by(signal),
    }
}

/// All that depends on the processor.
#[cfg(target_arch = "x86_64")]
mod registers {
    use corosensei::trap::TrapHandlerRegs;

    /// Program counter and stack pointer.
    pub(super) fn position(context: &libc::ucontext_t) -> (usize, usize) {
        let registers = &context.uc_mcontext.gregs;
        (registers[libc::REG_RIP as usize] as usize, registers[libc::REG_RSP as usize] as usize)
    }

    /// Sets the registers that the trap handler names.
    pub(super) fn redirect(context: &mut libc::ucontext_t, to: &TrapHandlerRegs) {
        let registers = &mut context.uc_mcontext.gregs;
        registers[libc::REG_RIP as usize] = to.rip as i64;
        registers[libc::REG_RSP as usize] = to.rsp as i64;
        registers[libc::REG_RBP as usize] = to.rbp as i64;
        registers[libc::REG_RDI as usize] = to.rdi as i64;
        registers[libc::REG_RSI as usize] = to.rsi as i64;
        // The plugin may have left the direction or alignment-check flag set.
        registers[libc::REG_EFL as usize] &= !0x4_0400;
    }
}

/// All that depends on the processor.
#[cfg(target_arch = "aarch64")]
mod registers {
    use corosensei::trap::TrapHandlerRegs;

    /// Program counter and stack pointer.
    pub(super) fn position(context: &libc::ucontext_t) -> (usize, usize) {
        (context.uc_mcontext.pc as usize, context.uc_mcontext.sp as usize)
    }

    /// Sets the registers that the trap handler names.
    pub(super) fn redirect(context: &mut libc::ucontext_t, to: &TrapHandlerRegs) {
        let registers = &mut context.uc_mcontext;
        registers.pc = to.pc;
        registers.sp = to.sp;
        registers.regs[0] = to.x0;
        registers.regs[1] = to.x1;
        registers.regs[29] = to.x29;
        registers.regs[30] = to.lr;
    }
}

#[cfg(test)]
mod tests {
    use crate::sys::fiber::{Ended, Fiber};
    use crate::sys::thread::SignalStack;

    #[inline(never)]
    fn deep(depth: u64) -> u64 {
        let frame = std::hint::black_box([depth; 64]);
        if depth == 0 { 0 } else { deep(depth + 1) + frame[3] }
    }

    fn trapped(mut closure: impl FnMut()) -> super::Trap {
        super::install();
        let _stack = SignalStack::new();
        let mut fiber = Fiber::new(64 << 10).unwrap();
        assert_eq!(fiber.run(&mut closure), Ended::Trapped);
        super::take().expect("the handler tells what it saw")
    }

    #[test]
    fn a_bad_write_ends_the_fiber_and_not_the_thread() {
        // SAFETY: none; the write faults, which is what is tested.
        let trap = trapped(|| unsafe { std::hint::black_box(16 as *mut u32).write_volatile(1) });
        assert_eq!((trap.evidence.signal, trap.evidence.address), (libc::SIGSEGV, 16));
        assert!(!trap.stack_overflow);
    }

    #[test]
    fn an_exhausted_stack_is_told_from_a_bad_address() {
        assert!(trapped(|| _ = std::hint::black_box(deep(1))).stack_overflow);
    }

    #[test]
    fn the_same_thread_traps_again_and_again() {
        for _ in 0..100 {
            // SAFETY: none; the write faults, which is what is tested.
            trapped(|| unsafe { std::hint::black_box(8 as *mut u32).write_volatile(1) });
        }
    }
}
