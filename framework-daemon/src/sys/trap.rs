//! Fatal signals on a fiber end the fiber; anywhere else the process says its last words and ends.
//!
//! The handler asks first whether foreign code runs on this thread: a fiber is armed and the stack pointer lies in it.
//! It allocates nothing, takes no lock and calls nothing that is not async-signal-safe.
#![allow(unsafe_code, reason = "address of unsafe: signal handlers and register contexts")]

use std::cell::Cell;
use std::sync::Once;

use corosensei::trap::CoroutineTrapHandler;

use super::last_words::{Death, End};
use super::{arch, clock, last_words, text};
use crate::model::fault::TrapEvidence;
use crate::model::limits::STACK_WORDS;

/// The signals that end a fiber.
pub const SIGNALS: [i32; 5] = [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGABRT];

/// What the handler saw.
#[derive(Clone, Copy, Debug)]
pub struct Trap {
    /// Signal, address, registers.
    pub evidence: TrapEvidence,
    /// The access hit the guard page below the fiber's stack.
    pub stack_overflow: bool,
    /// The component called `exit` or one of its kin.
    pub exited: bool,
    /// The component called `abort`, or a runtime of its own did.
    pub asked: bool,
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

    /// The link register and the top of the stack, as far as they can be read.
    fn top(&self, context: &libc::ucontext_t, sp: usize) -> [u64; STACK_WORDS] {
        let mut words = [0; STACK_WORDS];
        let link = arch::link(context);
        words[0] = link.unwrap_or_default();
        let sound = sp.is_multiple_of(size_of::<u64>()) && sp >= self.stack_low + GUARD_BYTES;
        let places = (sp..).step_by(size_of::<u64>()).take_while(|place| {
            sound
                && self.handler.stack_ptr_in_bounds(*place)
                && self.handler.stack_ptr_in_bounds(*place + size_of::<u64>())
        });
        for (word, place) in words[usize::from(link.is_some())..].iter_mut().zip(places) {
            // SAFETY: the word lies between the guard page and the upper end of a stack that is mapped, and its fiber is
            // interrupted.
            *word = unsafe { std::ptr::with_exposed_provenance::<u64>(place).read() };
        }
        words
    }
}

thread_local! {
    // `const` and without destructor: the handler may read it at any moment.
    static ARMED: Cell<*const Armed> = const { Cell::new(std::ptr::null()) };
    static EXITING: Cell<bool> = const { Cell::new(false) };
    static ASKED: Cell<bool> = const { Cell::new(false) };
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
    ASKED.set(true);
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

/// Takes the fatal signals over from whoever had them, once in a process.
pub fn install() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        text::install();
        SIGNALS.into_iter().for_each(install_one);
    });
}

fn install_one(signal: i32) {
    // SAFETY: an all-zero `sigaction` is valid; the handler has the signature that SA_SIGINFO asks for.
    unsafe {
        let mut new: libc::sigaction = std::mem::zeroed();
        new.sa_sigaction = handle as extern "C" fn(i32, *mut libc::siginfo_t, *mut libc::c_void) as usize;
        // No SA_NODEFER: a second trap of this kind inside the handler ends the process instead of recursing.
        new.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
        libc::sigaction(signal, &raw const new, std::ptr::null_mut());
    }
}

extern "C" fn handle(signal: i32, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    let at_ns = clock::now_ns();
    // SAFETY: the kernel passes valid pointers for the time of the call (SA_SIGINFO).
    let (info, context) = unsafe { (&mut *info, &mut *context.cast::<libc::ucontext_t>()) };
    let (pc, sp) = registers::position(context);
    // SAFETY: a fiber is armed only while it runs, borrowed by this very thread.
    let armed = unsafe { ARMED.get().as_ref() };
    let sent = is_sent(info);
    // SAFETY: all of these signals carry an address where an instruction caused them.
    let address = if sent.is_some() { 0 } else { unsafe { info.si_addr() }.addr() };
    let Some(armed) = armed.filter(|armed| armed.handler.stack_ptr_in_bounds(sp) && sent != Some(false)) else {
        let sender = sent.map(|_| sender(info));
        last_words::speak(&Death { end: End::Crash, signal, address, pc, sender });
        return end_by(signal);
    };
    let guard = armed.stack_low..armed.stack_low + GUARD_BYTES;
    TRAP.set(Some(Trap {
        evidence: TrapEvidence {
            signal,
            code: info.si_code,
            address: address as u64,
            pc: pc as u64,
            sp: sp as u64,
            stack: armed.top(context, sp),
            registers: arch::registers(context),
        },
        stack_overflow: signal == libc::SIGSEGV && guard.contains(&address),
        exited: EXITING.replace(false),
        asked: ASKED.replace(false),
        at_ns,
    }));
    // SAFETY: the interrupted stack pointer lies in this fiber, which is alive: it is armed only while it runs. All
    // registers that the trap handler names are set, and the handler returns.
    unsafe { registers::redirect(context, &armed.handler.setup_trap_handler(|| ())) };
}

/// Some when the signal was sent and not caused by an instruction; true when this process sent it to itself (`abort`).
fn is_sent(info: &libc::siginfo_t) -> Option<bool> {
    // SAFETY: a system call without arguments.
    (info.si_code <= 0).then(|| sender(info) == unsafe { libc::getpid() })
}

fn sender(info: &libc::siginfo_t) -> i32 {
    // SAFETY: asked only of a signal that was sent, which carries its sender.
    unsafe { info.si_pid() }
}

/// The process ends by this signal, as its supervisor expects. Not by the standard library's handler: it writes to a stderr
/// that nobody may read.
fn end_by(signal: i32) {
    // SAFETY: the default action is restored; the signal is blocked while its handler runs and ends the process when that
    // returns.
    unsafe {
        libc::signal(signal, libc::SIG_DFL);
        libc::raise(signal);
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
