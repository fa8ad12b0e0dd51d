//! The fibers of one executor: idle ones by size of stack, those that wait, and those that a trap ended.

use std::sync::Arc;

use super::carrier::{self, Lease};
use super::fiber::{Ended, Errand, Fiber, NEVER, State};
use super::pulse::Pulse;
use super::trap::Trap;
use crate::model::limits::{IDLE_FIBERS, TOUCHED_STACK_BYTES, WAITING_FIBERS};

/// Fibers with stacks of one size.
#[allow(clippy::vec_box, reason = "they are moved from one to the other")]
type Shelf<E> = Vec<Box<Fiber<E>>>;

/// Fibers for one executor, by size of stack.
pub struct FiberPool<E: Errand> {
    // Boxed: one that trapped is put aside while a recovery waits.
    idle: Vec<(usize, Shelf<E>)>,
    spent: Shelf<E>,
    waiting: Vec<Option<Box<Fiber<E>>>>,
    lease: Lease,
}

/// Stands for a fiber that waits.
#[derive(Debug, PartialEq, Eq)]
pub struct Ticket(usize);

/// How far an errand got.
pub enum Progress<E> {
    /// It is done.
    Done(Box<E>),
    /// A trap ended it; [`FiberPool::trap`] tells which.
    Trapped(Box<E>),
    /// It waits until that moment, unless it is to go on before.
    Waits(Ticket, u64),
}

impl<E: Errand> Default for FiberPool<E> {
    /// For the executor whose thread calls it.
    fn default() -> Self {
        Self {
            idle: Vec::new(),
            spent: Vec::new(),
            waiting: Vec::with_capacity(WAITING_FIBERS),
            lease: carrier::lease(),
        }
    }
}

impl<E: Errand> FiberPool<E> {
    /// Runs `closure` on a fiber with a stack of that size; it must return until `deadline_ns`.
    ///
    /// # Errors
    /// When a new fiber is needed and the system has no address space left.
    #[inline]
    pub fn run(&mut self, stack_bytes: usize, deadline_ns: u64, closure: &mut dyn FnMut()) -> std::io::Result<Ended> {
        let shelf = stocked(&mut self.idle, stack_bytes, &self.lease)?;
        // In its place on the shelf: fibers do not nest.
        if shelf.last_mut().is_some_and(|fiber| fiber.run(deadline_ns, closure) == Ended::Returned) {
            return Ok(Ended::Returned);
        }
        self.put_aside(stack_bytes);
        Ok(Ended::Trapped)
    }

    /// The first fiber of that size is spent.
    #[cold]
    #[inline(never)]
    fn put_aside(&mut self, stack_bytes: usize) {
        let fiber = shelf(&mut self.idle, stack_bytes).pop();
        self.spent.extend(fiber);
    }

    /// Runs `errand` on a fiber with a stack of that size; it must return until `deadline_ns`, or wait, where it may.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn begin(
        &mut self,
        stack_bytes: usize,
        deadline_ns: u64,
        may_wait: bool,
        errand: Box<E>,
    ) -> std::io::Result<Progress<E>> {
        let shelf = stocked(&mut self.idle, stack_bytes, &self.lease)?;
        let Some(fiber) = shelf.last_mut() else { return Err(std::io::ErrorKind::OutOfMemory.into()) };
        // In its place on the shelf, as long as it does not wait.
        fiber.begin(deadline_ns, may_wait, errand);
        if fiber.state == State::Idle
            && let Some(errand) = fiber.take_errand()
        {
            return Ok(Progress::Done(errand));
        }
        let fiber = shelf.pop();
        fiber.and_then(|fiber| self.sort(fiber)).ok_or_else(|| std::io::ErrorKind::Other.into())
    }

    /// Goes on with an errand that waits; where it may not wait any more, it comes to its end. `None`: there is none.
    #[allow(clippy::needless_pass_by_value, reason = "a ticket is good for once")]
    pub fn go_on(&mut self, ticket: Ticket, deadline_ns: u64, may_wait: bool) -> Option<Progress<E>> {
        let mut fiber = self.waiting.get_mut(ticket.0)?.take()?;
        fiber.go_on(deadline_ns, may_wait);
        self.sort(fiber)
    }

    /// Nobody will go on with that errand.
    #[allow(clippy::needless_pass_by_value, reason = "a ticket is good for once")]
    pub fn abandon(&mut self, ticket: Ticket) {
        self.spent.extend(self.waiting.get_mut(ticket.0).and_then(Option::take));
    }

    /// Gives out an idle fiber with a stack of that size, for errands that are begun from within others.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn lend(&mut self, stack_bytes: usize) -> std::io::Result<Box<Fiber<E>>> {
        let fiber = stocked(&mut self.idle, stack_bytes, &self.lease)?.pop();
        fiber.ok_or_else(|| std::io::ErrorKind::OutOfMemory.into())
    }

    /// Takes a fiber back that was lent and has run an errand.
    pub fn take_back(&mut self, fiber: Box<Fiber<E>>) -> Option<Progress<E>> {
        self.sort(fiber)
    }

    /// Takes a fiber back that was lent and is idle.
    pub fn take_back_idle(&mut self, fiber: Box<Fiber<E>>) {
        shelf(&mut self.idle, fiber.stack_bytes).push(fiber);
    }

    /// Puts a fiber that ran an errand to where it belongs now.
    fn sort(&mut self, mut fiber: Box<Fiber<E>>) -> Option<Progress<E>> {
        if let State::Waiting(until_ns) = fiber.state {
            let place = self.waiting.iter().position(Option::is_none).unwrap_or_else(|| {
                self.waiting.push(None);
                self.waiting.len() - 1
            });
            self.waiting[place] = Some(fiber);
            return Some(Progress::Waits(Ticket(place), until_ns));
        }
        let errand = fiber.take_errand()?;
        if fiber.state == State::Idle {
            shelf(&mut self.idle, fiber.stack_bytes).push(fiber);
            return Some(Progress::Done(errand));
        }
        self.spent.push(fiber);
        Some(Progress::Trapped(errand))
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
#[inline]
fn shelf<E: Errand>(idle: &mut Vec<(usize, Shelf<E>)>, stack_bytes: usize) -> &mut Shelf<E> {
    // Most executors have one size.
    let is_first = idle.first().is_some_and(|(size, _)| *size == stack_bytes);
    let index = if is_first { 0 } else { place(idle, stack_bytes) };
    &mut idle[index].1
}

/// Where fibers with a stack of that size are.
#[inline(never)]
fn place<E: Errand>(idle: &mut Vec<(usize, Shelf<E>)>, stack_bytes: usize) -> usize {
    idle.iter().position(|(size, _)| *size == stack_bytes).unwrap_or_else(|| {
        idle.push((stack_bytes, Vec::with_capacity(IDLE_FIBERS)));
        idle.len() - 1
    })
}

/// As [`shelf`], with a fiber on it at least.
#[inline]
fn stocked<'a, E: Errand>(
    idle: &'a mut Vec<(usize, Shelf<E>)>,
    stack_bytes: usize,
    lease: &Lease,
) -> std::io::Result<&'a mut Shelf<E>> {
    let shelf = shelf(idle, stack_bytes);
    if shelf.is_empty() {
        stock(shelf, stack_bytes, lease)?;
    }
    Ok(shelf)
}

#[cold]
#[inline(never)]
fn stock<E: Errand>(shelf: &mut Shelf<E>, stack_bytes: usize, lease: &Lease) -> std::io::Result<()> {
    shelf.push(Box::new(Fiber::leased(stack_bytes, lease)?));
    Ok(())
}

/// Touches as much of a stack as a first callback may need, so that it need not wait for pages.
fn touch_stack() {
    std::hint::black_box(&std::mem::MaybeUninit::<[u8; TOUCHED_STACK_BYTES]>::uninit());
}

#[cfg(test)]
#[allow(unsafe_code, reason = "a trap, which is what is tested")]
mod tests {
    use super::super::fiber::{NotHere, park};
    use super::super::trap;
    use super::*;

    /// Waits as often as it is told, where it may.
    struct Waits {
        times: u32,
        refused: u32,
    }

    impl Errand for Waits {
        fn run(&mut self) {
            for _ in 0..self.times {
                self.refused += u32::from(park(7).is_err());
            }
        }
    }

    fn waits(times: u32) -> Box<Waits> {
        Box::new(Waits { times, refused: 0 })
    }

    #[test]
    fn errands_that_wait_go_on_in_any_order_and_others_run_meanwhile() {
        let mut pool = FiberPool::default();
        let mut tickets = Vec::new();
        for _ in 0..3 {
            match pool.begin(64 << 10, NEVER, true, waits(2)).unwrap() {
                Progress::Waits(ticket, 7) => tickets.push(ticket),
                _ => panic!("it waits"),
            }
        }
        assert_eq!(pool.run(64 << 10, NEVER, &mut || ()).unwrap(), Ended::Returned);
        for _ in 0..2 {
            tickets = tickets
                .drain(..)
                .rev()
                .filter_map(|ticket| match pool.go_on(ticket, NEVER, true).unwrap() {
                    Progress::Waits(ticket, _) => Some(ticket),
                    Progress::Done(errand) => {
                        assert_eq!(errand.refused, 0);
                        None
                    }
                    Progress::Trapped(_) => panic!("nothing trapped"),
                })
                .collect();
        }
        assert!(tickets.is_empty());
    }

    #[test]
    fn what_may_not_wait_any_more_comes_to_its_end() {
        let mut pool = FiberPool::default();
        let Progress::Waits(ticket, _) = pool.begin(64 << 10, NEVER, true, waits(5)).unwrap() else {
            panic!("it waits")
        };
        let Some(Progress::Done(errand)) = pool.go_on(ticket, NEVER, false) else { panic!("it ends") };
        assert_eq!(errand.refused, 4, "the first wait had begun");
    }

    #[test]
    fn nobody_waits_outside_of_an_errand_and_one_that_is_abandoned_is_never_resumed() {
        assert_eq!(park(1), Err(NotHere));
        let mut pool = FiberPool::default();
        let mut inside = Ok(());
        pool.run(64 << 10, NEVER, &mut || inside = park(1)).unwrap();
        assert_eq!(inside, Err(NotHere));
        let Progress::Waits(ticket, _) = pool.begin(64 << 10, NEVER, true, waits(1)).unwrap() else {
            panic!("it waits")
        };
        pool.abandon(ticket);
        pool.bury();
    }

    #[test]
    fn an_errand_that_traps_after_a_wait_is_given_back() {
        struct Traps;
        impl Errand for Traps {
            fn run(&mut self) {
                let _ = park(1);
                // SAFETY: none; the write faults, which is what is tested.
                unsafe { std::hint::black_box(16 as *mut u32).write_volatile(1) };
            }
        }
        trap::install();
        let _stack = crate::sys::thread::SignalStack::new();
        let mut pool = FiberPool::default();
        let Progress::Waits(ticket, _) = pool.begin(64 << 10, NEVER, true, Box::new(Traps)).unwrap() else {
            panic!("it waits")
        };
        assert!(matches!(pool.go_on(ticket, NEVER, true), Some(Progress::Trapped(_))));
        assert_eq!(pool.trap().map(|trap| trap.evidence.address), Some(16));
    }

    #[test]
    fn a_pool_keeps_its_fibers() {
        let mut pool = FiberPool::<()>::default();
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
