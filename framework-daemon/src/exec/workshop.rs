//! One background thread prepares what recoveries use up, and clears away what they leave: spares are created and
//! initialised, old instances destroyed.
//!
//! A recovery takes a spare from its slot's [`crate::exec::workshop::Shelf`] and leaves the instance that failed there, without a lock or an
//! allocation, and goes on; the thread here works when the robot does again. It runs under the ordinary scheduler: an
//! executor with a real-time priority is never kept from its period by it.
//!
//! Preparing on the executor's own thread after the recovery was the alternative: a constructor that takes milliseconds
//! would cost its neighbours their periods.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Duration;

use crossbeam_queue::ArrayQueue;

use super::member::Crew;
use super::recover;
use super::slot::{Slot, Status};
use super::unit::{Recipe, Unit};
use crate::model::fault::{Fault, FaultEvent, FaultSender, Outcome, Times};
use crate::model::ladder::Answer;
use crate::model::limits::{CLEARED_UNITS, SHUTDOWN_STEP, SLOTS, SPARE_PAUSE_MAX, SPARE_PAUSE_MIN};
use crate::model::schedule::Schedule;
use crate::model::symptom::SeverityTable;
use crate::model::time::nanoseconds;
use crate::sys::carrier::{self, Carried};
use crate::sys::wake::Waker;
use crate::sys::{clock, grave, watchdog};

/// Shelves that want something, each at most once, and what wakes the thread.
struct Orders {
    shelves: ArrayQueue<Arc<Shelf>>,
    waker: Waker,
    quit: AtomicBool,
    ordered: AtomicU64,
    served: AtomicU64,
}

/// What is prepared for one slot, and what waits to be cleared away after it. The slot's executor takes and leaves, the
/// workshop fills and clears.
pub struct Shelf {
    slot: Arc<Slot>,
    recipes: Vec<Recipe>,
    severity: SeverityTable,
    /// How many spares there are to be.
    spares: usize,
    /// Number of the recipe in use: spares are made after it.
    in_use: AtomicUsize,
    ready: ArrayQueue<Box<Unit>>,
    cleared: ArrayQueue<Box<Unit>>,
    /// The slot's executor has one at hand.
    at_hand: AtomicBool,
    waits: AtomicBool,
    closed: AtomicBool,
    orders: Arc<Orders>,
}

impl Shelf {
    /// How the slot's instances are made: number 0 is the primary, the others are the secondaries in the ladder's order.
    #[must_use]
    pub fn recipe(&self, number: usize) -> &Recipe {
        &self.recipes[number]
    }

    /// How the slot's instances are made, all of them.
    #[must_use]
    pub fn recipes(&self) -> &[Recipe] {
        &self.recipes
    }

    /// Sizes of the stacks that its instances need.
    pub fn stacks(&self) -> impl Iterator<Item = usize> {
        self.recipes.iter().map(|recipe| recipe.limits.stack_bytes)
    }

    /// Spares that are ready, and how many there are to be.
    #[must_use]
    pub fn stock(&self) -> (usize, usize) {
        (self.ready.len() + usize::from(self.at_hand.load(Ordering::Relaxed)), self.spares)
    }

    /// Number of the recipe in use.
    #[must_use]
    pub fn in_use(&self) -> usize {
        self.in_use.load(Ordering::Relaxed)
    }

    /// From now on instances are made after that recipe.
    pub fn follow(&self, recipe: usize) {
        self.in_use.store(recipe, Ordering::Release);
    }

    /// A spare of the class in use, where one is ready.
    #[must_use]
    pub fn take(&self) -> Option<Box<Unit>> {
        let wanted = self.in_use();
        while let Some(unit) = self.ready.pop() {
            if unit.recipe == wanted {
                return Some(unit);
            }
            // Full of others: those that are left behind wait for the next order.
            if self.cleared.push(unit).is_err() {
                return None;
            }
        }
        None
    }

    /// True when nothing is ready.
    #[must_use]
    #[inline]
    pub fn is_bare(&self) -> bool {
        self.ready.is_empty()
    }

    /// The slot's executor took one in advance, or used it.
    pub fn set_at_hand(&self, at_hand: bool) {
        self.at_hand.store(at_hand, Ordering::Release);
    }

    /// The spare of that number, if it is here.
    pub(super) fn take_instance(&self, number: u64) -> Option<Box<Unit>> {
        (0..self.ready.len()).filter_map(|_| self.ready.pop()).find_map(|unit| {
            if unit.owner.instance == number {
                return Some(unit);
            }
            // There is room: it was taken out just now, unless the workshop was faster.
            self.ready.push(unit).err().and_then(|unit| self.cleared.push(unit).err())
        })
    }

    /// Least time that one of its callbacks is entered with, in nanoseconds.
    #[must_use]
    pub fn shortest_ns(&self) -> u64 {
        self.recipes.iter().map(|recipe| recipe.limits.hang_ns).min().unwrap_or(u64::MAX)
    }

    /// Leaves a unit to be ended; gives it back where the workshop does not keep up.
    ///
    /// # Errors
    /// The unit, which its executor must end itself.
    pub fn clear(&self, unit: Box<Unit>) -> Result<(), Box<Unit>> {
        self.cleared.push(unit)
    }

    /// Asks for what is missing, and that what was left is cleared away.
    pub fn order(self: &Arc<Self>) {
        if !self.waits.swap(true, Ordering::AcqRel) {
            self.orders.put(Arc::clone(self));
        }
    }

    /// The slot stopped for good: what is ready for it is ended with the next order.
    pub fn retire(&self) {
        self.closed.store(true, Ordering::SeqCst);
    }

    /// The slot works again after it had stopped: the next order prepares for it.
    pub fn reopen(&self) {
        self.closed.store(false, Ordering::SeqCst);
    }

    /// The slot ends: nothing is prepared for it any more; returns what was there. What is being prepared at this moment
    /// is ended by the workshop.
    pub fn close(&self) -> impl Iterator<Item = Box<Unit>> {
        self.retire();
        std::iter::from_fn(|| self.cleared.pop().or_else(|| self.ready.pop()))
    }

    fn is_closed(&self) -> bool {
        self.closed.load(Ordering::SeqCst)
    }

    fn wants_more(&self) -> bool {
        !self.is_closed() && self.stock().0 < self.spares
    }
}

impl Orders {
    fn put(&self, shelf: Arc<Shelf>) {
        self.ordered.fetch_add(1, Ordering::Relaxed);
        // Each shelf is in the queue at most once, so that it cannot be full.
        if self.shelves.push(shelf).is_err() {
            self.served.fetch_add(1, Ordering::Relaxed);
        }
        self.waker.wake();
    }

    fn is_idle(&self) -> bool {
        self.served.load(Ordering::Acquire) == self.ordered.load(Ordering::Acquire)
    }
}

/// The workshop as others see it.
pub struct Workshop {
    orders: Arc<Orders>,
    thread: Option<Carried>,
}

impl Workshop {
    /// Starts its thread.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub fn start(faults: FaultSender) -> std::io::Result<Self> {
        let orders = Arc::new(Orders {
            shelves: ArrayQueue::new(2 * SLOTS),
            waker: Waker::default(),
            quit: AtomicBool::new(false),
            ordered: AtomicU64::new(0),
            served: AtomicU64::new(0),
        });
        let own = Arc::clone(&orders);
        let body = move || Worker::new(own, faults).until_quit();
        let thread = carrier::spawn("workshop", Schedule::default(), |_| {}, body)?;
        Ok(Self { orders, thread: Some(thread) })
    }

    /// A shelf for a slot whose instances are made after these recipes, with that many spares.
    #[must_use]
    pub fn shelf(&self, slot: &Arc<Slot>, recipes: Vec<Recipe>, spares: usize, severity: SeverityTable) -> Arc<Shelf> {
        Arc::new(Shelf {
            slot: Arc::clone(slot),
            recipes: recipes.into_iter().zip(0..).map(|(recipe, number)| Recipe { number, ..recipe }).collect(),
            severity,
            spares,
            in_use: AtomicUsize::new(0),
            ready: ArrayQueue::new(spares.max(1)),
            cleared: ArrayQueue::new(CLEARED_UNITS),
            at_hand: AtomicBool::new(false),
            waits: AtomicBool::new(false),
            closed: AtomicBool::new(false),
            orders: Arc::clone(&self.orders),
        })
    }

    /// Waits until all that was ordered was tried once, but no longer than `limit`; false: it was not.
    pub fn settle(&self, limit: Duration) -> bool {
        let end = clock::now_ns() + nanoseconds(limit);
        while !self.orders.is_idle() && clock::now_ns() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.orders.is_idle()
    }
}

impl Drop for Workshop {
    /// Tells the thread to end; one that hangs in a constructor is left behind.
    fn drop(&mut self) {
        self.orders.quit.store(true, Ordering::Release);
        self.orders.waker.wake();
        let Some(thread) = self.thread.take() else { return };
        let _ = self.settle(SHUTDOWN_STEP);
        let limit = clock::now_ns() + 100_000_000;
        while self.orders.is_idle() && !thread.is_over() && clock::now_ns() < limit {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

/// A slot whose spare failed: the next try waits.
struct Resting {
    shelf: Arc<Shelf>,
    until_ns: u64,
    pause: Duration,
}

/// The thread's side.
struct Worker {
    orders: Arc<Orders>,
    crew: Crew,
    resting: Vec<Resting>,
}

impl Worker {
    fn new(orders: Arc<Orders>, faults: FaultSender) -> Self {
        let crew = Crew::new(faults);
        Self { orders, crew, resting: Vec::new() }
    }

    fn until_quit(mut self) {
        while !self.orders.quit.load(Ordering::Acquire) {
            while let Some(shelf) = self.orders.shelves.pop() {
                shelf.waits.store(false, Ordering::Release);
                self.serve(&shelf);
                self.crew.fibers.bury();
                grave::level_many();
                self.orders.served.fetch_add(1, Ordering::Release);
            }
            self.wake_resting();
            let next = self.resting.iter().map(|resting| resting.until_ns).min();
            self.orders.waker.wait_until(next);
        }
    }

    fn serve(&mut self, shelf: &Arc<Shelf>) {
        watchdog::expect(self.crew.fibers.pulse(), shelf.shortest_ns());
        self.clear_outdated(shelf);
        while let Some(unit) = shelf.cleared.pop() {
            self.crew.end(&shelf.slot, unit);
        }
        if self.resting.iter().all(|resting| !Arc::ptr_eq(&resting.shelf, shelf)) {
            self.fill(shelf, SPARE_PAUSE_MIN);
        }
    }

    /// Spares of a class, or of a slot, that is not in use any more.
    fn clear_outdated(&mut self, shelf: &Shelf) {
        for _ in 0..shelf.ready.len() {
            let Some(unit) = shelf.ready.pop() else { return };
            if unit.recipe == shelf.in_use.load(Ordering::Acquire) && !shelf.is_closed() {
                put_back(&mut self.crew, shelf, unit);
            } else {
                self.crew.end(&shelf.slot, unit);
            }
        }
    }

    /// Prepares what is missing. After a failure the slot rests, longer each time.
    fn fill(&mut self, shelf: &Arc<Shelf>, pause: Duration) {
        while shelf.wants_more() {
            let number = shelf.in_use.load(Ordering::Acquire);
            match self.crew.prepare(&shelf.slot, shelf.recipe(number)) {
                Ok(unit) => put_back(&mut self.crew, shelf, unit),
                Err(fault) => {
                    self.tell(shelf, number, fault);
                    let until_ns = clock::now_ns() + nanoseconds(pause);
                    self.resting.push(Resting { shelf: Arc::clone(shelf), until_ns, pause });
                    return;
                }
            }
        }
    }

    fn wake_resting(&mut self) {
        let now = clock::now_ns();
        while let Some(index) = self.resting.iter().position(|resting| resting.until_ns <= now) {
            let Resting { shelf, pause, .. } = self.resting.swap_remove(index);
            self.fill(&shelf, (pause * 2).min(SPARE_PAUSE_MAX));
            self.crew.fibers.bury();
        }
    }

    /// A spare that fails is a fault of its slot, though the slot works on.
    fn tell(&self, shelf: &Shelf, number: usize, fault: Fault) {
        Status::count(&shelf.slot.status.faults);
        shelf.slot.status.count_taint(fault.memory);
        let event = FaultEvent {
            slot: shelf.slot.name,
            class: shelf.recipe(number).class_name,
            severity: shelf.severity.get(fault.symptom),
            answer: Answer::Prepare,
            successor: Some(shelf.slot.status.class()),
            outcome: Outcome::Failed,
            checkpoint_ns: None,
            cause: None,
            times: Times { detected_ns: fault.detected_ns.saturating_sub(fault.at_ns), ..Times::default() },
            fault,
        };
        recover::send(&self.crew.faults, event);
    }
}

/// Puts a unit on its shelf; ends it where the slot ended meanwhile.
fn put_back(crew: &mut Crew, shelf: &Shelf, unit: Box<Unit>) {
    if let Err(unit) = shelf.ready.push(unit) {
        crew.end(&shelf.slot, unit);
    }
    if shelf.is_closed() {
        while let Some(unit) = shelf.ready.pop() {
            crew.end(&shelf.slot, unit);
        }
    }
}
