//! A callback runs on a fiber: a stack of its own, resumed by its executor thread.
//!
//! A trap makes the fiber return to its executor ([`crate::sys::trap`]); its stack is put aside whole, never resumed, unwound
//! or freed, so no frame is deallocated under a destructor. `siglongjmp` over Rust frames was measured as fast and is
//! undefined for that very reason.
#![allow(unsafe_code, reason = "address of unsafe: stacks, and closures that cross to them")]

use std::cell::{Cell, OnceCell, UnsafeCell};
use std::mem::ManuallyDrop;
use std::ops::Range;
use std::rc::Rc;
use std::sync::Arc;

use corosensei::stack::Stack;
use corosensei::{Coroutine, CoroutineResult};

use super::carrier::Lease;
use super::stack::OwnStack;
use super::trap::{self, Armed, Trap};
use super::{arch, clock, grave, shield};

/// A deadline that is never over.
pub const NEVER: u64 = u64::MAX;

/// A closure on its way to the fiber: one thin pointer to the borrow that [`Fiber::run`] holds. Wider values on this way
/// are written as halves and read as a whole, which stalls the processor for longer than the switch itself takes.
type Job = *mut &'static mut dyn FnMut();

/// Work that may wait, and so outlives the call that began it. It lies with its fiber: to carry it there and back would take
/// half as long as the switch.
pub trait Errand: Send + 'static {
    /// What came of it.
    type Report: Copy;

    /// Does it.
    fn run(&mut self);

    /// What came of it so far: it is over, or a trap ended it.
    fn report(&self) -> Self::Report;
}

/// No errand: for fibers that run closures only.
impl Errand for () {
    type Report = ();

    fn run(&mut self) {}

    fn report(&self) {}
}

/// What a fiber and its executor share.
struct Core<E> {
    armed: OnceCell<Armed>,
    job: Cell<Job>,
    errand: UnsafeCell<Option<E>>,
}

/// In the place of a job: the errand.
const ERRAND: Job = std::ptr::without_provenance_mut(align_of::<&'static mut dyn FnMut()>());

/// A stack and what runs on it. Runs one closure after the other, and errands of one kind: which one it is need not be asked
/// on the way into every callback.
pub struct Fiber<E: Errand> {
    coroutine: ManuallyDrop<Coroutine<(), (), (), OwnStack>>,
    core: Rc<Core<E>>,
    /// Its stack's addresses.
    range: Range<usize>,
    pub(super) stack_bytes: usize,
    pub(super) state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    /// For the next closure.
    Idle,
    /// In the middle of an errand, until that moment or until it is to go on before.
    Waiting(u64),
    /// A trap ended it, or nobody will resume it.
    Spent,
}

/// How a closure on a fiber ended. Small, because it is returned from every callback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// It returned.
    Returned,
    /// A trap ended it, and the fiber with it; [`Fiber::trap`] tells which. The thread may be another one than
    /// before.
    Trapped,
}

/// Whoever asked may not wait: it runs on a thread of its own, in a signal handler, or in a callback that must not wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotHere;

/// Suspends the fiber that calls it, not its thread, until somebody rings for its member or the time is over. It may return
/// for no reason: it is the body of a loop over a condition. Never inlined: the thread may be another one afterwards.
///
/// # Errors
/// Where nobody may wait.
#[inline(never)]
pub fn park(until_ns: u64) -> Result<(), NotHere> {
    trap::begin_wait(until_ns).ok_or(NotHere)?.suspend(());
    Ok(())
}

/// The callback that runs on another fiber of this thread, and may wait: another one can be entered from within it, on a fiber of
/// its own. A trap ends the inner one only, and whoever entered it goes on.
pub struct Outer {
    armed: &'static Armed,
    limit_ns: u64,
}

impl Outer {
    /// The one that calls this, and must return within that many nanoseconds afterwards; `None`: it may not wait, or there is
    /// none.
    #[must_use]
    pub fn here(limit_ns: u64) -> Option<Self> {
        trap::patient().map(|armed| Self { armed, limit_ns })
    }
}

impl<E: Errand> Fiber<E> {
    /// A fiber with a stack of about `stack_bytes` and a guard page below, of no executor in particular.
    ///
    /// # Errors
    /// When the system has no address space left.
    pub fn new(stack_bytes: usize) -> std::io::Result<Self> {
        Self::leased(stack_bytes, &Lease::default())
    }

    /// A fiber of the executor with this lease.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn leased(stack_bytes: usize, lease: &Lease) -> std::io::Result<Self> {
        let stack = OwnStack::new(stack_bytes)?;
        let (low, high, range) = (stack.limit().get(), stack.base().get(), stack.range());
        let core: Rc<Core<E>> = Rc::new(Core {
            armed: OnceCell::new(),
            job: Cell::new(std::ptr::null_mut()),
            errand: UnsafeCell::new(None),
        });
        // Not counted: what a fiber that traps holds is never dropped.
        let shared = Rc::as_ptr(&core);
        let coroutine = Coroutine::with_stack(stack, move |yielder, ()| {
            // SAFETY: as below.
            unsafe { (*shared).armed.get() }.iter().for_each(|armed| armed.settle_in(yielder));
            loop {
                // SAFETY: the fiber is resumed by its `Fiber` only, which holds the core.
                let job = unsafe { (*shared).job.get() };
                if job.is_null() {
                    return;
                }
                if job == ERRAND {
                    // SAFETY: set by `begin`; nobody else touches it until this suspends without waiting.
                    unsafe { (*(*shared).errand.get()).iter_mut().for_each(E::run) };
                } else {
                    // SAFETY: `run` sets a pointer to a borrow that it holds until this suspends.
                    unsafe { (*job)() };
                }
                yielder.suspend(());
            }
        });
        let pulse = Arc::clone(&lease.pulse);
        core.armed.get_or_init(|| Armed::new(coroutine.trap_handler(), low..high, pulse, lease.relay));
        let coroutine = ManuallyDrop::new(coroutine);
        Ok(Self { coroutine, core, range, stack_bytes, state: State::Idle })
    }

    /// Runs `closure` on the fiber until it returns or traps, or is ended because `deadline_ns` (on the monotonic clock) is
    /// over and somebody watches.
    ///
    /// What the closure owns is leaked by a trap: give it borrows of plain data only. Never inlined: the caller may be on
    /// another thread afterwards, and must not have kept the address of a thread-local.
    ///
    /// # Panics
    /// After a trap: the fiber is spent.
    #[inline(never)]
    pub fn run(&mut self, deadline_ns: u64, closure: &mut dyn FnMut()) -> Ended {
        assert!(self.state == State::Idle, "a fiber that trapped or waits takes no closure");
        // SAFETY: only the lifetime changes; the closure is borrowed until `resume` returns, and the fiber never
        // touches it later: it may not wait, so it asks for the next job, or it is spent.
        let mut borrow = unsafe { std::mem::transmute::<&mut dyn FnMut(), &'static mut dyn FnMut()>(closure) };
        self.core.job.set(&raw mut borrow);
        self.state = self.resume(deadline_ns, false);
        if self.state == State::Idle { Ended::Returned } else { Ended::Trapped }
    }

    /// Says what its errand is: `fill` finds the one that it ran last. Nothing happens unless it is idle.
    #[inline(always)]
    pub fn furnish(&mut self, fill: impl FnOnce(&mut Option<E>)) {
        if self.state == State::Idle {
            // SAFETY: the fiber is idle: it does not touch it.
            fill(unsafe { &mut *self.core.errand.get() });
        }
    }

    /// Runs its errand until that returns, traps or waits, where it may; where it returned, this is the errand. Otherwise as
    /// [`Self::run`]; whoever calls it is never inlined.
    ///
    /// # Panics
    /// As [`Self::run`].
    #[inline(always)]
    pub fn begin(&mut self, deadline_ns: u64, may_wait: bool) -> Option<&E> {
        assert!(self.state == State::Idle, "a fiber that trapped or waits takes no errand");
        self.core.job.set(ERRAND);
        let after = self.resume(deadline_ns, may_wait);
        if after != State::Idle {
            self.state = after;
            return None;
        }
        // SAFETY: the fiber is idle: it does not touch it.
        unsafe { (*self.core.errand.get()).as_ref() }
    }

    /// Runs its errand from within a callback on another fiber, until it returns, traps or waits, within that many nanoseconds;
    /// returns when it began and ended, to a tick. Otherwise as [`Self::begin`].
    ///
    /// # Panics
    /// As [`Self::run`].
    #[inline(never)]
    pub fn begin_within(&mut self, outer: &Outer, limit_ns: u64) -> (u64, u64) {
        let began_ns = clock::recent_ns();
        let _ = self.begin((began_ns + clock::TICK_NS).saturating_add(limit_ns), true);
        let ended_ns = clock::recent_ns();
        // As after any wait. What is left of its time may be less than the watchdog expects of what begins.
        outer.armed.run_on((ended_ns + clock::TICK_NS).saturating_add(outer.limit_ns));
        (began_ns, ended_ns)
    }

    /// True where it returned and did not trap.
    #[inline]
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.state == State::Idle
    }

    /// Bytes of its stack that were asked for.
    #[must_use]
    pub const fn stack_bytes(&self) -> usize {
        self.stack_bytes
    }

    /// Goes on with an errand that waits; where it may not wait any more, it comes to its end. Otherwise as
    /// [`Self::run`]; whoever calls it is never inlined.
    #[inline(always)]
    pub(super) fn go_on(&mut self, deadline_ns: u64, may_wait: bool) {
        self.state = self.resume(deadline_ns, may_wait);
    }

    /// How it is afterwards.
    #[inline(always)]
    fn resume(&mut self, deadline_ns: u64, may_wait: bool) -> State {
        let Some(armed) = self.core.armed.get() else { return State::Spent };
        armed.arm(deadline_ns, may_wait);
        let result = self.coroutine.resume(());
        shield::end_copy();
        armed.disarm();
        arch::restore_float_control();
        match result {
            CoroutineResult::Yield(()) => armed.take_wait().map_or(State::Idle, State::Waiting),
            CoroutineResult::Return(()) => State::Spent,
        }
    }

    /// The errand that it ran last; `None`: that waits, or there was none.
    #[inline]
    #[must_use]
    pub fn errand(&self) -> Option<&E> {
        if matches!(self.state, State::Waiting(_)) {
            return None;
        }
        // SAFETY: the fiber is idle or spent: it does not touch it.
        unsafe { (*self.core.errand.get()).as_ref() }
    }

    /// The trap that ended it.
    #[must_use]
    pub fn trap(&self) -> Option<&Trap> {
        self.core.armed.get().and_then(Armed::trap)
    }
}

impl<E: Errand> Drop for Fiber<E> {
    fn drop(&mut self) {
        if self.state == State::Idle {
            // Its loop ends by itself; only then may its stack be freed.
            self.core.job.set(std::ptr::null_mut());
            self.coroutine.resume(());
            // SAFETY: dropped once, here, and not used afterwards.
            unsafe { ManuallyDrop::drop(&mut self.coroutine) };
        } else {
            // One that overflowed is in memory as a whole.
            let is_full = self.trap().is_some_and(|trap| trap.stack_overflow);
            let bytes = if is_full { usize::MAX } else { self.stack_bytes };
            // SAFETY: nothing runs on it any more, and nobody frees it: the coroutine is never dropped. One that waits is
            // not resumed either: what it waits for is gone.
            unsafe { grave::entomb(self.range.clone(), bytes) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fiber_runs_one_closure_after_the_other() {
        let mut fiber = Fiber::<()>::new(64 << 10).unwrap();
        let mut sum = 0;
        for i in 0..100 {
            assert!(matches!(fiber.run(NEVER, &mut || sum += i), Ended::Returned));
        }
        assert_eq!(sum, 4950);
    }
}
