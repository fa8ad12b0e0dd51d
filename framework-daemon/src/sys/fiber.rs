//! A callback runs on a fiber: a stack of its own, resumed by its executor thread.
//!
//! A trap makes the fiber return to its executor ([`crate::sys::trap`]); its stack is put aside whole, never resumed, unwound
//! or freed, so no frame is deallocated under a destructor. `siglongjmp` over Rust frames was measured as fast and is
//! undefined for that very reason.
#![allow(unsafe_code, reason = "address of unsafe: stacks, and closures that cross to them")]

use std::cell::{Cell, OnceCell};
use std::mem::ManuallyDrop;
use std::ops::Range;
use std::rc::Rc;
use std::sync::Arc;

use corosensei::stack::Stack;
use corosensei::{Coroutine, CoroutineResult};

use super::arch;
use super::carrier::{self, Lease};
use super::pulse::Pulse;
use super::shield;
use super::stack::{self, OwnStack};
use super::trap::{Armed, Trap};
use crate::model::limits::{IDLE_FIBERS, TOUCHED_STACK_BYTES};

/// A deadline that is never over.
pub const NEVER: u64 = u64::MAX;

/// A closure on its way to the fiber: one thin pointer to the borrow that [`Fiber::run`] holds. Wider values on this way
/// are written as halves and read as a whole, which stalls the processor for longer than the switch itself takes.
type Job = *mut &'static mut dyn FnMut();

/// What a fiber and its executor share.
struct Core {
    armed: OnceCell<Armed>,
    job: Cell<Job>,
}

/// A stack and what runs on it. Runs one closure after the other.
pub struct Fiber {
    coroutine: ManuallyDrop<Coroutine<(), (), (), OwnStack>>,
    core: Rc<Core>,
    /// Its stack's addresses.
    range: Range<usize>,
    usable: bool,
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

impl Fiber {
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
        let core = Rc::new(Core { armed: OnceCell::new(), job: Cell::new(std::ptr::null_mut()) });
        // Not counted: what a fiber that traps holds is never dropped.
        let shared = Rc::as_ptr(&core);
        let coroutine = Coroutine::with_stack(stack, move |yielder, ()| {
            loop {
                // SAFETY: the fiber is resumed by its `Fiber` only, which holds the core.
                let job = unsafe { (*shared).job.get() };
                if job.is_null() {
                    return;
                }
                // SAFETY: `run` sets a pointer to a borrow that it holds until this suspends.
                unsafe { (*job)() };
                yielder.suspend(());
            }
        });
        let pulse = Arc::clone(&lease.pulse);
        core.armed.get_or_init(|| Armed::new(coroutine.trap_handler(), low..high, pulse, lease.relay));
        Ok(Self { coroutine: ManuallyDrop::new(coroutine), core, range, usable: true })
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
        assert!(self.usable, "a fiber that trapped is never resumed");
        // SAFETY: only the lifetime changes; the closure is borrowed until `resume` returns, and the fiber never
        // touches it later: it asks for the next job, or it is spent.
        let mut borrow = unsafe { std::mem::transmute::<&mut dyn FnMut(), &'static mut dyn FnMut()>(closure) };
        self.core.job.set(&raw mut borrow);
        let armed = self.core.armed.get();
        armed.inspect(|armed| armed.arm(deadline_ns));
        let result = self.coroutine.resume(());
        shield::end_copy();
        armed.inspect(|armed| armed.disarm());
        arch::restore_float_control();
        match result {
            CoroutineResult::Yield(()) => Ended::Returned,
            CoroutineResult::Return(()) => {
                self.usable = false;
                Ended::Trapped
            }
        }
    }

    /// The trap that ended it.
    #[must_use]
    pub fn trap(&self) -> Option<&Trap> {
        self.core.armed.get().and_then(Armed::trap)
    }

    /// False after a trap.
    #[must_use]
    pub const fn is_usable(&self) -> bool {
        self.usable
    }
}

impl Drop for Fiber {
    fn drop(&mut self) {
        if self.usable {
            // Its loop ends by itself; only then may its stack be freed.
            self.core.job.set(std::ptr::null_mut());
            self.coroutine.resume(());
            // SAFETY: dropped once, here, and not used afterwards.
            unsafe { ManuallyDrop::drop(&mut self.coroutine) };
        } else {
            // SAFETY: nothing runs on it any more, and nobody frees it: the coroutine is never dropped.
            unsafe { stack::entomb(self.range.clone()) };
        }
    }
}

/// Touches as much of a stack as a first callback may need, so that it need not wait for pages.
fn touch_stack() {
    std::hint::black_box(&std::mem::MaybeUninit::<[u8; TOUCHED_STACK_BYTES]>::uninit());
}

/// Fibers with stacks of one size.
#[allow(clippy::vec_box, reason = "they are moved from one to the other")]
type Shelf = Vec<Box<Fiber>>;

/// Fibers for one executor, by size of stack.
pub struct FiberPool {
    // Boxed: one that trapped is put aside while a recovery waits.
    idle: Vec<(usize, Shelf)>,
    spent: Shelf,
    lease: Lease,
}

impl Default for FiberPool {
    /// For the executor whose thread calls it.
    fn default() -> Self {
        Self { idle: Vec::new(), spent: Vec::new(), lease: carrier::lease() }
    }
}

impl FiberPool {
    /// Runs `closure` on a fiber with a stack of that size; it must return until `deadline_ns`.
    ///
    /// # Errors
    /// When a new fiber is needed and the system has no address space left.
    pub fn run(&mut self, stack_bytes: usize, deadline_ns: u64, closure: &mut dyn FnMut()) -> std::io::Result<Ended> {
        let lease = &self.lease;
        let shelf = shelf(&mut self.idle, stack_bytes);
        if shelf.is_empty() {
            shelf.push(Box::new(Fiber::leased(stack_bytes, lease)?));
        }
        // In its place on the shelf: fibers do not nest, and moving one costs as much as entering it.
        if shelf.last_mut().is_some_and(|fiber| fiber.run(deadline_ns, closure) == Ended::Returned) {
            return Ok(Ended::Returned);
        }
        if let Some(fiber) = shelf.pop() {
            self.spent.push(fiber);
        }
        Ok(Ended::Trapped)
    }

    /// The last trap since the last burial.
    #[must_use]
    pub fn trap(&self) -> Option<&Trap> {
        self.spent.last().and_then(|fiber| fiber.trap())
    }

    /// What the watchdog reads of this executor.
    #[must_use]
    pub const fn pulse(&self) -> &Arc<Pulse> {
        &self.lease.pulse
    }

    /// Makes sure that a fiber of that size is there, so that a recovery need not map a stack.
    ///
    /// # Errors
    /// When the system has no address space left.
    pub fn prepare(&mut self, stack_bytes: usize, count: usize) -> std::io::Result<()> {
        self.spent.reserve(IDLE_FIBERS);
        let (shelf, lease) = (shelf(&mut self.idle, stack_bytes), &self.lease);
        while shelf.len() < count {
            let mut fiber = Box::new(Fiber::leased(stack_bytes, lease)?);
            fiber.run(NEVER, &mut touch_stack);
            shelf.push(fiber);
        }
        Ok(())
    }

    /// Gives the pages of spent fibers back; a few microseconds each, so it is done when the recovery is over.
    pub fn bury(&mut self) {
        self.spent.clear();
    }
}

/// Fibers with a stack of that size.
fn shelf(idle: &mut Vec<(usize, Shelf)>, stack_bytes: usize) -> &mut Shelf {
    let index = idle.iter().position(|(size, _)| *size == stack_bytes).unwrap_or_else(|| {
        idle.push((stack_bytes, Vec::with_capacity(IDLE_FIBERS)));
        idle.len() - 1
    });
    &mut idle[index].1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fiber_runs_one_closure_after_the_other() {
        let mut fiber = Fiber::new(64 << 10).unwrap();
        let mut sum = 0;
        for i in 0..100 {
            assert!(matches!(fiber.run(NEVER, &mut || sum += i), Ended::Returned));
        }
        assert_eq!(sum, 4950);
    }

    #[test]
    fn a_pool_keeps_its_fibers() {
        let mut pool = FiberPool::default();
        let mut address = [0usize; 2];
        for slot in &mut address {
            pool.run(64 << 10, NEVER, &mut || {
                let local = 0u8;
                *slot = (&raw const local).addr();
            })
            .unwrap();
        }
        assert_eq!(address[0], address[1]);
    }
}
