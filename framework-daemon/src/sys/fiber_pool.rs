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

/// No stack is that large.
const NONE_YET: usize = usize::MAX;

/// Fibers for one executor, by size of stack.
pub struct FiberPool<E: Errand> {
    /// The size of stack that was asked for first. Most executors have one: to look for it is half of the way to a fiber.
    bytes: usize,
    // Boxed: one that trapped is put aside while a recovery waits.
    idle: Shelf<E>,
    others: Vec<(usize, Shelf<E>)>,
    spent: Shelf<E>,
    waiting: Vec<Option<Box<Fiber<E>>>>,
    lease: Lease,
}

/// Stands for a fiber that waits.
#[derive(Debug, PartialEq, Eq)]
pub struct Ticket(usize);

/// How far an errand got, with its report.
pub enum Progress<R> {
    /// It is done.
    Done(R),
    /// A trap ended it; [`FiberPool::trap`] tells which.
    Trapped(R),
    /// It waits until that moment, unless it is to go on before.
    Waits(Ticket, u64),
}

impl<E: Errand> Default for FiberPool<E> {
    /// For the executor whose thread calls it.
    fn default() -> Self {
        Self {
            bytes: NONE_YET,
            idle: Vec::new(),
            others: Vec::new(),
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
        // In its place on the shelf: fibers do not nest.
        if self.ready(stack_bytes)?.run(deadline_ns, closure) == Ended::Returned {
            return Ok(Ended::Returned);
        }
        self.put_aside(stack_bytes);
        Ok(Ended::Trapped)
    }

    /// The first fiber of that size is spent.
    #[cold]
    #[inline(never)]
    fn put_aside(&mut self, stack_bytes: usize) {
        let fiber = self.shelf(stack_bytes).pop();
        self.spent.extend(fiber);
    }

    /// Runs an errand on a fiber with a stack of that size; it must return until `deadline_ns`, or wait, where it may. `fill`
    /// says what it is: the one that the fiber ran last is still there.
    ///
    /// # Errors
    /// As [`Self::run`].
    #[inline(never)]
    pub fn begin(
        &mut self,
        stack_bytes: usize,
        deadline_ns: u64,
        may_wait: bool,
        fill: impl FnOnce(&mut Option<E>),
    ) -> std::io::Result<Progress<E::Report>> {
        let fiber = self.ready(stack_bytes)?;
        fiber.furnish(fill);
        let _ = fiber.begin(deadline_ns, may_wait);
        self.sort_out(stack_bytes).ok_or_else(|| std::io::ErrorKind::Other.into())
    }

    /// The fiber with a stack of that size that is the next to run, in its place: it is sorted out afterwards, unless it is idle.
    ///
    /// # Errors
    /// As [`Self::run`].
    #[inline]
    pub fn ready(&mut self, stack_bytes: usize) -> std::io::Result<&mut Fiber<E>> {
        let is_at_hand = self.bytes == stack_bytes && !self.idle.is_empty();
        let shelf = if is_at_hand { &mut self.idle } else { self.stocked(stack_bytes)? };
        shelf.last_mut().map(|fiber| &mut **fiber).ok_or_else(|| std::io::ErrorKind::OutOfMemory.into())
    }

    /// Puts the fiber of that size that ran in its place to where it belongs now.
    pub fn sort_out(&mut self, stack_bytes: usize) -> Option<Progress<E::Report>> {
        let fiber = self.shelf(stack_bytes).pop()?;
        self.sort(fiber)
    }

    /// Goes on with an errand that waits; where it may not wait any more, it comes to its end. `None`: there is none.
    #[allow(clippy::needless_pass_by_value, reason = "a ticket is good for once")]
    #[inline(never)]
    pub fn go_on(&mut self, ticket: Ticket, deadline_ns: u64, may_wait: bool) -> Option<Progress<E::Report>> {
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
        let fiber = self.stocked(stack_bytes)?.pop();
        fiber.ok_or_else(|| std::io::ErrorKind::OutOfMemory.into())
    }

    /// Takes a fiber back that was lent and has run an errand.
    pub fn take_back(&mut self, fiber: Box<Fiber<E>>) -> Option<Progress<E::Report>> {
        self.sort(fiber)
    }

    /// Takes a fiber back that was lent and is idle.
    pub fn take_back_idle(&mut self, fiber: Box<Fiber<E>>) {
        self.shelf(fiber.stack_bytes).push(fiber);
    }

    /// Puts a fiber that ran an errand to where it belongs now.
    fn sort(&mut self, fiber: Box<Fiber<E>>) -> Option<Progress<E::Report>> {
        if let State::Waiting(until_ns) = fiber.state {
            let place = self.waiting.iter().position(Option::is_none).unwrap_or_else(|| {
                self.waiting.push(None);
                self.waiting.len() - 1
            });
            self.waiting[place] = Some(fiber);
            return Some(Progress::Waits(Ticket(place), until_ns));
        }
        let report = fiber.errand()?.report();
        if fiber.state == State::Idle {
            self.shelf(fiber.stack_bytes).push(fiber);
            return Some(Progress::Done(report));
        }
        self.spent.push(fiber);
        Some(Progress::Trapped(report))
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
        while self.shelf(stack_bytes).len() < count {
            let mut fiber = Box::new(Fiber::leased(stack_bytes, &self.lease)?);
            fiber.run(NEVER, &mut touch_stack);
            self.shelf(stack_bytes).push(fiber);
        }
        Ok(())
    }

    /// Fibers with a stack of that size.
    fn shelf(&mut self, stack_bytes: usize) -> &mut Shelf<E> {
        if self.bytes == NONE_YET {
            (self.bytes, self.idle) = (stack_bytes, Vec::with_capacity(IDLE_FIBERS));
        }
        if self.bytes == stack_bytes {
            return &mut self.idle;
        }
        let others = &mut self.others;
        let index = others.iter().position(|(size, _)| *size == stack_bytes).unwrap_or_else(|| {
            others.push((stack_bytes, Vec::with_capacity(IDLE_FIBERS)));
            others.len() - 1
        });
        &mut others[index].1
    }

    /// The same, with one on it at least.
    #[inline(never)]
    fn stocked(&mut self, stack_bytes: usize) -> std::io::Result<&mut Shelf<E>> {
        if self.shelf(stack_bytes).is_empty() {
            let fiber = Box::new(Fiber::leased(stack_bytes, &self.lease)?);
            self.shelf(stack_bytes).push(fiber);
        }
        Ok(self.shelf(stack_bytes))
    }

    /// Gives the pages of spent fibers back; a few microseconds each, so it is done when the recovery is over.
    pub fn bury(&mut self) {
        self.spent.clear();
    }
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
        type Report = u32;

        fn run(&mut self) {
            for _ in 0..self.times {
                self.refused += u32::from(park(7).is_err());
            }
        }

        fn report(&self) -> u32 {
            self.refused
        }
    }

    fn waits(times: u32) -> impl FnOnce(&mut Option<Waits>) {
        move |place| *place = Some(Waits { times, refused: 0 })
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
                    Progress::Done(refused) => {
                        assert_eq!(refused, 0);
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
        let Some(Progress::Done(refused)) = pool.go_on(ticket, NEVER, false) else { panic!("it ends") };
        assert_eq!(refused, 4, "the first wait had begun");
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
    fn an_errand_that_traps_after_a_wait_reports_how_far_it_got() {
        struct Traps(u32);
        impl Errand for Traps {
            type Report = u32;

            fn run(&mut self) {
                let _ = park(1);
                self.0 += 1;
                // SAFETY: none; the write faults, which is what is tested.
                unsafe { std::hint::black_box(16 as *mut u32).write_volatile(1) };
            }

            fn report(&self) -> u32 {
                self.0
            }
        }
        trap::install();
        let _stack = crate::sys::thread::SignalStack::new();
        let mut pool = FiberPool::default();
        let Progress::Waits(ticket, _) = pool.begin(64 << 10, NEVER, true, |place| *place = Some(Traps(7))).unwrap()
        else {
            panic!("it waits")
        };
        assert!(matches!(pool.go_on(ticket, NEVER, true), Some(Progress::Trapped(8))));
        assert_eq!(pool.trap().map(|trap| trap.evidence.address), Some(16));
    }

    #[test]
    fn a_pool_keeps_its_fibers_of_each_size() {
        let mut pool = FiberPool::<()>::default();
        let sizes = [0, 64 << 10, 1 << 20, 0, 64 << 10, 1 << 20];
        let addresses = sizes.map(|bytes| {
            let mut address = 0;
            let closure = &mut || address = (&raw const *std::hint::black_box(&0u8)).addr() & !0xfff;
            pool.run(bytes, NEVER, closure).unwrap();
            address
        });
        assert_eq!(addresses[..3], addresses[3..]);
        pool.prepare(0, 2).unwrap();
        assert_eq!(pool.shelf(0).len(), 2);
    }
}
