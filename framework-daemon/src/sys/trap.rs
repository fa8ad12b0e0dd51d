//! Fatal signals on a fiber end the fiber; anywhere else the process says its last words and ends. So does the watchdog's
//! signal when the callback on the fiber is late.
//!
//! The handler asks first whether foreign code runs on this thread: a fiber is armed, and the stack pointer lies in it. Then
//! where the program counter is ([`crate::sys::trap::Site`]): where no lock can be held the fiber ends by a change of registers, and the
//! executor goes on at once. Elsewhere (in the allocator, in a system call) the *thread* is given up: it passes its
//! executor to a reserve thread and ends on the spot, without a destructor; a lock that it holds stays with nobody who
//! would take it again.
//!
//! The handler allocates nothing, takes no lock and calls nothing that is not async-signal-safe.
#![allow(unsafe_code, reason = "address of unsafe: signal handlers and register contexts")]

use std::cell::Cell;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Once};

use corosensei::Yielder;
use corosensei::trap::CoroutineTrapHandler;

use super::fence::{self, Verdict};
use super::last_words::{self, Death, End};
use super::pulse::Pulse;
use super::relay::Relay;
use super::seen::{Seen, Sight};
pub use super::seen::{Site, Trap};
use super::shield::handlers;
use super::{arch, clock, foreign, heap, leaf, mapping, shield, text, thread};
use crate::model::limits::{CALLERS, HANG_ATTEMPTS, HANG_ATTEMPTS_IN_DAEMON, STACK_WORDS};

/// The signals that end a fiber.
pub const SIGNALS: [i32; 7] =
    [libc::SIGSEGV, libc::SIGBUS, libc::SIGFPE, libc::SIGILL, libc::SIGABRT, libc::SIGSYS, libc::SIGTRAP];

/// The watchdog's: one that nobody else uses.
#[must_use]
pub fn watchdog_signal() -> i32 {
    libc::SIGRTMAX() - 3
}

/// A fiber that runs on some thread: what the handler needs to end it.
pub(super) struct Armed {
    handler: CoroutineTrapHandler<()>,
    stack: Range<usize>,
    pulse: Arc<Pulse>,
    relay: Option<&'static Relay<Armed>>,
    trap: Seen,
    wait: Wait,
}

/// Whether the code on the fiber may wait, and until when it does.
struct Wait {
    allowed: Cell<bool>,
    /// 0: it does not.
    until_ns: Cell<u64>,
    /// Where it suspends itself: on its stack, for as long as that lives.
    yielder: Cell<*const Yielder<(), ()>>,
}

impl Wait {
    const fn new() -> Self {
        Self { allowed: Cell::new(false), until_ns: Cell::new(0), yielder: Cell::new(std::ptr::null()) }
    }
}

impl Armed {
    /// Of the fiber of that handler, with its stack, guard included, and what belongs to its executor.
    pub(super) const fn new(
        handler: CoroutineTrapHandler<()>,
        stack: Range<usize>,
        pulse: Arc<Pulse>,
        relay: Option<&'static Relay<Self>>,
    ) -> Self {
        Self { handler, stack, pulse, relay, trap: Seen::new(), wait: Wait::new() }
    }

    /// Says that the fiber runs on this thread from now on and must return until then, or wait, where it may. Fibers do not
    /// nest.
    #[inline]
    pub(super) fn arm(&self, deadline_ns: u64, may_wait: bool) {
        self.wait.allowed.set(may_wait);
        handlers::forget();
        ARMED.set(self);
        self.pulse.begin(deadline_ns);
    }

    /// Says that the fiber returned. Thread-locals are not touched: the thread may be another one than before.
    #[inline]
    pub(super) fn disarm(&self) {
        self.pulse.end();
    }

    /// It runs on, after another one that ran from within it, and must return until then. Never inlined: the thread may
    /// be another one than before.
    #[inline(never)]
    pub(super) fn run_on(&self, deadline_ns: u64) {
        ARMED.set(self);
        self.pulse.begin(deadline_ns);
    }

    /// The fiber runs for the first time: this is where it suspends itself.
    pub(super) fn settle_in(&self, yielder: &Yielder<(), ()>) {
        self.wait.yielder.set(yielder);
    }

    /// Until when the code on the fiber waits; `None`: it does not.
    #[inline]
    pub(super) fn take_wait(&self) -> Option<u64> {
        let until_ns = self.wait.until_ns.get();
        if until_ns == 0 {
            return None;
        }
        self.wait.until_ns.set(0);
        Some(until_ns)
    }

    /// The trap that ended it.
    pub(super) fn trap(&self) -> Option<&Trap> {
        self.trap.get()
    }

    /// Takes the executor over from the thread that was given up: goes on where it waits for this fiber.
    ///
    /// # Safety
    /// The fiber must have been passed by the thread that ran it, which never touches it again.
    pub(super) unsafe fn take_over(&self) -> ! {
        ARMED.set(self);
        self.pulse.move_to(thread::id());
        // SAFETY: the fiber waits for its end; its thread is gone (the caller's promise).
        unsafe { arch::continue_at(&self.handler.setup_trap_handler(|| ())) }
    }

    /// True where plugin code runs: on the fiber's stack, or on one that it brought along or lost its way to.
    fn holds(&self, pc: usize, sp: usize) -> bool {
        self.pulse.is_beating() && (self.handler.stack_ptr_in_bounds(sp) || (text::is_plugin(pc) && !self.is_stray()))
    }

    /// True on a kernel thread that only shares the thread-locals of the executor's.
    fn is_stray(&self) -> bool {
        let thread = self.pulse.thread();
        thread != 0 && thread != thread::id()
    }

    fn guard(&self) -> Range<usize> {
        self.stack.start..self.stack.start + GUARD_BYTES
    }

    /// Where the interrupted function returns to, if it has no frame.
    fn caller(&self, context: &libc::ucontext_t) -> usize {
        let (_, sp) = arch::position(context);
        if sp < self.guard().end || !self.handler.stack_ptr_in_bounds(sp) {
            return 0;
        }
        // SAFETY: above its guard the fiber's stack is mapped.
        unsafe { arch::return_address(context) }
    }

    /// Who in a plugin called what was interrupted.
    fn callers(&self, context: &libc::ucontext_t) -> [u64; CALLERS] {
        // SAFETY: above its guard the fiber's stack is mapped, and its fiber is interrupted.
        unsafe { callers(context, self.guard().end..self.stack.end) }
    }

    fn site(&self, address: usize, context: &libc::ucontext_t) -> Site {
        Site::of(address, arch::position(context).0, self.caller(context))
    }

    /// Ends the fiber where no lock can be held, the thread elsewhere; `tell` writes down what was seen.
    fn end(&self, site: Site, tell: impl FnOnce(&mut Trap)) -> ! {
        handlers::forget();
        let relay = self.relay.filter(|_| site == Site::Elsewhere);
        self.trap.fill(|trap| {
            tell(trap);
            (trap.site, trap.thread_lost) = (site, relay.is_some());
        });
        self.pulse.end();
        match relay {
            None => {
                // SAFETY: the interrupted stack pointer lies in this fiber, which is alive: it is armed only while it
                // runs, and it runs on this thread. Nothing that the handler holds needs to be dropped.
                unsafe { arch::continue_at(&self.handler.setup_trap_handler(|| ())) }
            }
            Some(relay) => {
                THREADS_LOST.fetch_add(1, Ordering::Relaxed);
                heap::abandon_thread();
                // Where not even a place is left for it, the executor ends with its thread.
                relay.pass(std::ptr::from_ref(self).cast_mut());
                arch::exit_thread();
            }
        }
    }
}

impl Drop for Armed {
    /// What armed this thread last is asked for as long as the thread lives.
    fn drop(&mut self) {
        if std::ptr::eq(ARMED.get(), self) {
            ARMED.set(std::ptr::null());
        }
    }
}

/// Why one of our own functions struck.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Raised {
    Nothing,
    Abort,
    Exit,
    /// A check of the heap failed.
    Check,
}

thread_local! {
    // `const` and without destructor: the handler may read them at any moment.
    static ARMED: Cell<*const Armed> = const { Cell::new(std::ptr::null()) };
    static RAISED: Cell<Raised> = const { Cell::new(Raised::Nothing) };
}

static THREADS_LOST: AtomicU64 = AtomicU64::new(0);

/// Bytes above the lower end of a stack that count as its guard: one page.
const GUARD_BYTES: usize = 4096;

/// Threads that were given up so far. Each leaves the memory of its stack behind.
#[must_use]
pub fn threads_lost() -> u64 {
    THREADS_LOST.load(Ordering::Relaxed)
}

/// True while plugin code runs on a fiber of this thread.
#[must_use]
#[inline(never)]
pub fn on_fiber() -> bool {
    armed().is_some_and(|armed| armed.pulse.is_beating())
}

/// True on a thread that a callback made by `clone`: it shares the thread-locals of the thread that runs the callback.
pub(super) fn is_stray() -> bool {
    armed().is_some_and(|armed| armed.pulse.is_beating() && armed.is_stray())
}

/// What runs on this thread's fiber begins the next part of its errand: it must return until then, or wait, where it may.
#[inline(never)]
pub fn rearm(deadline_ns: u64, may_wait: bool) {
    if let Some(armed) = armed() {
        armed.wait.allowed.set(may_wait);
        armed.pulse.begin(deadline_ns);
    }
}

/// The code on this thread's fiber is about to wait: where it suspends itself; `None`: it may not, or there is no fiber.
#[inline(never)]
pub(super) fn begin_wait(until_ns: u64) -> Option<&'static Yielder<(), ()>> {
    let armed = patient()?;
    armed.wait.until_ns.set(until_ns.max(1));
    // SAFETY: on the stack of the fiber that runs here, which lives as long as the code that asks.
    unsafe { armed.wait.yielder.get().as_ref() }
}

/// The fiber of this thread, where the code on it may wait.
#[inline(never)]
pub(super) fn patient() -> Option<&'static Armed> {
    let here = 0_u8;
    let waits = |armed: &&Armed| {
        armed.wait.allowed.get()
            && armed.pulse.is_beating()
            // No thread that only shares the thread-locals has its stack there.
            && armed.handler.stack_ptr_in_bounds((&raw const here).addr())
            && !handlers::is_here()
    };
    armed().filter(waits)
}

fn armed() -> Option<&'static Armed> {
    // SAFETY: a fiber outlives its armed time; afterwards the pulse, shared by all fibers of the executor, says that
    // nothing runs.
    unsafe { ARMED.get().as_ref() }
}

/// Ends what runs on this thread as `abort` does: on a fiber the fiber; elsewhere by SIGABRT, and returns only where nobody
/// handles it.
pub fn raise_abort() {
    strike_fiber(Raised::Abort);
    // SAFETY: the set is initialised by `sigemptyset`; the calls take no other memory and are directed at this thread. It
    // is unblocked first: a plugin may have masked it.
    unsafe {
        let mut set: libc::sigset_t = std::mem::zeroed();
        libc::sigemptyset(&raw mut set);
        libc::sigaddset(&raw mut set, libc::SIGABRT);
        libc::pthread_sigmask(libc::SIG_UNBLOCK, &raw const set, std::ptr::null_mut());
        libc::raise(libc::SIGABRT);
    }
}

/// Ends the fiber of this thread, if one runs, because its component has damaged the heap.
pub fn raise_check() {
    strike_fiber(Raised::Check);
}

fn strike_fiber(raised: Raised) {
    if on_fiber() || handlers::is_here() {
        RAISED.set(raised);
        arch::strike();
    }
}

/// Ends the fiber of this thread because its component called `exit`.
pub fn raise_exit() {
    RAISED.set(Raised::Exit);
    arch::strike();
}

/// Takes the fatal signals over from whoever had them, once in a process.
pub fn install() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        text::install();
        leaf::install();
        heap::install();
        SIGNALS.into_iter().for_each(|signal| set_handler(signal, handle, libc::SA_NODEFER));
        // Real-time signals queue, and those that come while the thread waits for a processor would all be put on the
        // signal stack at once.
        set_handler(watchdog_signal(), time_out, 0);
    });
}

type Handler = extern "C" fn(i32, *mut libc::siginfo_t, *mut libc::c_void);

fn set_handler(signal: i32, handler: Handler, flags: i32) {
    // SAFETY: an all-zero `sigaction` is valid; the handler has the signature that SA_SIGINFO asks for.
    unsafe {
        let mut new: libc::sigaction = std::mem::zeroed();
        new.sa_sigaction = handler as usize;
        // No trap is held back meanwhile, so that a fiber is left without a system call that lets it through again. One
        // inside the handler is nobody's: it ends the process with its last words. SA_RESTART for a watchdog's signal
        // that comes too late to matter.
        new.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK | libc::SA_RESTART | flags;
        libc::sigaction(signal, &raw const new, std::ptr::null_mut());
    }
}

extern "C" fn handle(signal: i32, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    arch::allow_unaligned();
    let at_ns = clock::now_ns();
    // SAFETY: the kernel passes valid pointers for the time of the call (SA_SIGINFO).
    let (info, context) = unsafe { (&mut *info, &mut *context.cast::<libc::ucontext_t>()) };
    let (pc, sp) = arch::position(context);
    let verdict = fence::judge(info, context);
    if verdict == Some(Verdict::Answered) {
        return;
    }
    let sent = is_sent(info);
    // SAFETY: a SIGBUS that nobody sent carries an address.
    if signal == libc::SIGBUS && sent.is_none() && mapping::patch(unsafe { info.si_addr() }.addr()) {
        return;
    }
    let raised = RAISED.replace(Raised::Nothing);
    let signal = if raised == Raised::Nothing { signal } else { libc::SIGABRT };
    // SAFETY: all of these signals but SIGABRT carry an address where an instruction caused them.
    let address = if signal == libc::SIGABRT || sent.is_some() { 0 } else { unsafe { info.si_addr() }.addr() };
    let asked = raised == Raised::Abort || verdict.is_some();
    let exited = raised == Raised::Exit || verdict == Some(Verdict::Leaves);
    let sight = Sight { signal, code: info.si_code, address, at_ns, asked, exited };
    // A copy of this process that a plugin made is no business of ours, nor is a signal from outside.
    let is_guest = sent != Some(false) && !shield::is_copy();
    if is_guest && handlers::is_here() {
        let here = Trap { site: Site::of(address, pc, 0), ..sight.trap(context) };
        if handlers::struck(here, context) {
            return;
        }
    }
    if let Some(armed) = armed().filter(|armed| is_guest && armed.holds(pc, sp)) {
        // The function that makes any system call holds no lock.
        let site = if verdict.is_some() { Site::Leaf } else { armed.site(address, context) };
        armed.end(site, |trap| {
            sight.tell(trap, context);
            if site != Site::Plugin || pc == address {
                trap.evidence.callers = armed.callers(context);
            }
            trap.stack_overflow = signal == libc::SIGSEGV && armed.guard().contains(&address);
        });
    }
    if is_guest {
        foreign::struck(sight.trap(context), context);
    }
    // A copy of this process has no motors.
    if !shield::is_copy() {
        last_words::speak(&Death { end: End::Crash, signal, address, pc, sender: sent.map(|_| sender(info)) });
    }
    shield::stand_down();
    end_by(signal);
}

/// Return addresses into plugins: in the link register and on the top of the stack, as far as that lies in `stack`.
///
/// # Safety
/// `stack` must be mapped, and whoever runs on it interrupted.
pub(super) unsafe fn callers(context: &libc::ucontext_t, stack: Range<usize>) -> [u64; CALLERS] {
    let (mut found, (_, sp)) = ([0; CALLERS], arch::position(context));
    let is_sound = sp.is_multiple_of(size_of::<u64>()) && stack.contains(&sp);
    let count = if is_sound { STACK_WORDS.min((stack.end - sp) / size_of::<u64>()) } else { 0 };
    let start = std::ptr::with_exposed_provenance::<u64>(sp);
    // SAFETY: the words lie in the stack (the caller's promise).
    let words = (0..count).map(|index| unsafe { start.add(index).read() });
    let of_plugins = arch::link(context).into_iter().chain(words).filter(|word| text::is_plugin(*word as usize));
    for (place, word) in found.iter_mut().zip(of_plugins) {
        *place = word;
    }
    found
}

/// The watchdog's signal: the callback that runs on this thread, if it is still the one that is late.
extern "C" fn time_out(signal: i32, _: *mut libc::siginfo_t, context: *mut libc::c_void) {
    arch::allow_unaligned();
    // SAFETY: the kernel passes a valid pointer for the time of the call.
    let context = unsafe { &*context.cast::<libc::ucontext_t>() };
    let (pc, sp) = arch::position(context);
    let Some(armed) = armed().filter(|armed| armed.holds(pc, sp)) else { return };
    let seen_ns = clock::now_ns();
    let Some(at_ns) = armed.pulse.deadline_ns().filter(|deadline| *deadline <= seen_ns) else { return };
    let site = armed.site(0, context);
    // In the daemon's own function, or in the allocator of a component that is in and out of it: another moment is better.
    // A component that waits inside the C library will not leave it.
    let enough = match site {
        Site::Daemon => HANG_ATTEMPTS_IN_DAEMON,
        Site::Elsewhere if !arch::waits(context) => HANG_ATTEMPTS,
        _ => 0,
    };
    if armed.pulse.attempt() < enough {
        return;
    }
    armed.pulse.forget_attempts();
    // What was interrupted in the daemon may be half done: the thread that did it is not the one that goes on.
    let site = if site == Site::Daemon { Site::Elsewhere } else { site };
    let sight = Sight { signal, code: 0, address: 0, at_ns, asked: false, exited: false };
    armed.end(site, |trap| {
        sight.tell(trap, context);
        (trap.hang, trap.seen_ns) = (true, seen_ns);
        if site != Site::Plugin {
            trap.evidence.callers = armed.callers(context);
        }
        arch::let_through(context);
    })
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
    // SAFETY: the default action is restored, and ends the process.
    unsafe {
        libc::signal(signal, libc::SIG_DFL);
        libc::raise(signal);
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

    use crate::sys::fiber::NEVER;

    fn trapped(mut closure: impl FnMut()) -> super::Trap {
        super::install();
        let _stack = SignalStack::new();
        let mut fiber = Fiber::<()>::new(64 << 10).unwrap();
        assert_eq!(fiber.run(NEVER, &mut closure), Ended::Trapped);
        *fiber.trap().expect("the handler tells what it saw")
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
