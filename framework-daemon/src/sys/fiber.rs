//! A callback runs on a fiber: a stack of its own, resumed by its executor thread.
//!
//! A trap makes the fiber return to its executor ([`crate::sys::trap`]); its stack is put aside whole, never resumed, unwound
//! or freed, so no frame is deallocated under a destructor. `siglongjmp` over Rust frames was measured as fast and is
//! undefined for that very reason.
#![allow(unsafe_code, reason = "address of unsafe: stacks, and closures that cross to them")]

use std::mem::ManuallyDrop;

use corosensei::stack::{DefaultStack, Stack};
use corosensei::{Coroutine, CoroutineResult};

use super::trap::{self, Trap};

/// A closure on its way to the fiber; the pointer lives as long as the call of [`Fiber::run`].
#[derive(Clone, Copy)]
struct Job(*mut dyn FnMut());

/// A stack and what runs on it. Runs one closure after the other.
pub struct Fiber {
    coroutine: ManuallyDrop<Coroutine<Option<Job>, (), Option<Trap>>>,
    low: usize,
    high: usize,
    usable: bool,
}

/// How a closure on a fiber ended.
#[derive(Debug)]
pub enum Ended {
    /// It returned.
    Returned,
    /// A trap ended it, and the fiber with it.
    Trapped(Trap),
}

impl Fiber {
    /// A fiber with a stack of about `stack_bytes` and a guard page below.
    ///
    /// # Errors
    /// When the system has no address space left.
    pub fn new(stack_bytes: usize) -> std::io::Result<Self> {
        let stack = DefaultStack::new(stack_bytes)?;
        let (low, high) = (stack.limit().get(), stack.base().get());
        let coroutine = Coroutine::with_stack(stack, |yielder, mut next: Option<Job>| {
            while let Some(job) = next {
                // SAFETY: `run` passes a pointer to a closure that it borrows until this suspends.
                unsafe { (*job.0)() };
                next = yielder.suspend(());
            }
            None
        });
        Ok(Self { coroutine: ManuallyDrop::new(coroutine), low, high, usable: true })
    }

    /// Runs `closure` on the fiber until it returns or traps.
    ///
    /// What the closure owns is leaked by a trap: give it borrows of plain data only.
    ///
    /// # Panics
    /// After a trap: the fiber is spent.
    pub fn run(&mut self, closure: &mut dyn FnMut()) -> Ended {
        assert!(self.usable, "a fiber that trapped is never resumed");
        // SAFETY: only the lifetime changes; the closure is borrowed until `resume` returns, and the fiber never
        // touches it later: it asks for the next job, or it is spent.
        let job = Job(unsafe { std::mem::transmute::<*mut dyn FnMut(), *mut (dyn FnMut() + 'static)>(closure) });
        let armed = trap::arm(self.coroutine.trap_handler(), self.low);
        let result = self.coroutine.resume(Some(job));
        trap::disarm(armed);
        match result {
            CoroutineResult::Yield(()) => Ended::Returned,
            CoroutineResult::Return(trap) => {
                self.usable = false;
                trap.map_or(Ended::Returned, Ended::Trapped)
            }
        }
    }

    /// False after a trap.
    #[must_use]
    pub const fn is_usable(&self) -> bool {
        self.usable
    }

    /// Gives the pages of a spent stack back and makes its range inaccessible; the addresses are never used again,
    /// because a thread that the component started may still hold some.
    fn entomb(&self) {
        let (start, len) = (std::ptr::without_provenance_mut(self.low), self.high - self.low);
        // SAFETY: the range is exactly the mapping that `DefaultStack` made for this fiber, which nothing runs on any
        // more and nobody frees: the coroutine is never dropped.
        unsafe {
            libc::madvise(start, len, libc::MADV_DONTNEED);
            libc::mprotect(start, len, libc::PROT_NONE);
        }
    }
}

impl Drop for Fiber {
    fn drop(&mut self) {
        if self.usable {
            // Its loop ends by itself; only then may its stack be freed.
            self.coroutine.resume(None);
            // SAFETY: dropped once, here, and not used afterwards.
            unsafe { ManuallyDrop::drop(&mut self.coroutine) };
        } else {
            self.entomb();
        }
    }
}

/// Fibers for one thread, by size of stack.
#[derive(Default)]
pub struct FiberPool {
    idle: Vec<(usize, Vec<Fiber>)>,
    spent: Vec<Fiber>,
    buried: usize,
}

impl FiberPool {
    /// Runs `closure` on a fiber with a stack of that size.
    ///
    /// # Errors
    /// When a new fiber is needed and the system has no address space left.
    pub fn run(&mut self, stack_bytes: usize, closure: &mut dyn FnMut()) -> std::io::Result<Ended> {
        let mut fiber = self.take(stack_bytes)?;
        let ended = fiber.run(closure);
        if fiber.is_usable() {
            self.put(stack_bytes, fiber);
        } else {
            self.spent.push(fiber);
        }
        Ok(ended)
    }

    /// Makes sure that a fiber of that size is there, so that a recovery need not map a stack.
    ///
    /// # Errors
    /// When the system has no address space left.
    pub fn prepare(&mut self, stack_bytes: usize, count: usize) -> std::io::Result<()> {
        while self.shelf(stack_bytes).len() < count {
            let mut fiber = Fiber::new(stack_bytes)?;
            // Touches the stack's first page.
            fiber.run(&mut || {});
            self.put(stack_bytes, fiber);
        }
        Ok(())
    }

    fn take(&mut self, stack_bytes: usize) -> std::io::Result<Fiber> {
        self.shelf(stack_bytes).pop().map_or_else(|| Fiber::new(stack_bytes), Ok)
    }

    fn put(&mut self, stack_bytes: usize, fiber: Fiber) {
        self.shelf(stack_bytes).push(fiber);
    }

    fn shelf(&mut self, stack_bytes: usize) -> &mut Vec<Fiber> {
        let index = self.idle.iter().position(|(size, _)| *size == stack_bytes).unwrap_or_else(|| {
            self.idle.push((stack_bytes, Vec::with_capacity(crate::model::limits::IDLE_FIBERS)));
            self.idle.len() - 1
        });
        &mut self.idle[index].1
    }

    /// Gives the pages of spent fibers back; a few microseconds each, so it is done when the recovery is over.
    pub fn bury(&mut self) {
        self.buried += self.spent.len();
        self.spent.clear();
    }

    /// Fibers that traps ended: each keeps its range of addresses, but no memory.
    #[must_use]
    pub const fn buried(&self) -> usize {
        self.buried
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fiber_runs_one_closure_after_the_other() {
        let mut fiber = Fiber::new(64 << 10).unwrap();
        let mut sum = 0;
        for i in 0..100 {
            assert!(matches!(fiber.run(&mut || sum += i), Ended::Returned));
        }
        assert_eq!(sum, 4950);
    }

    #[test]
    fn a_pool_keeps_its_fibers() {
        let mut pool = FiberPool::default();
        let mut address = [0usize; 2];
        for slot in &mut address {
            pool.run(64 << 10, &mut || {
                let local = 0u8;
                *slot = (&raw const local).addr();
            })
            .unwrap();
        }
        assert_eq!(address[0], address[1]);
    }
}
