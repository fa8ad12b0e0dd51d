//! The way into a slot's handler from where another slot of its executor asks, as `exec::lane` has it: open while the slot
//! is at rest, a few times in each callback, for those who ask on its executor's thread.
//!
//! A handler that gives its thread up gives up that of whoever asked, too, which is on the same stack further down: so other
//! threads act while its call is in hand there. To set such a handler aside was the alternative: then nothing ever happens
//! in between.
#![allow(unsafe_code, reason = "the simulation plays the plugin, which reads what its handlers are shown")]

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, Weak};

use component_sdk::abi::calls::ServeArgs;
use framework_daemon::port::pattern::direct::{Lane, Served};
use framework_daemon::sys::fiber::{self, Errand, NEVER, Outer};
use framework_daemon::sys::fiber_pool::{FiberPool, Progress, Ticket};

use super::model::State;
use super::script::{Job, Script, Way};
use super::world::World;

pub(super) const STACK_BYTES: usize = 256 << 10;
const DRIVER_STACK_BYTES: usize = 64 << 10;

thread_local! {
    static POOLS: RefCell<Vec<Rc<RefCell<FiberPool<Script>>>>> = const { RefCell::new(Vec::new()) };
    static DRIVERS: RefCell<FiberPool<Driver>> = RefCell::default();
}

/// The fibers of a slot's callbacks. It has its own, because callbacks of different slots run within each other.
pub(super) fn fibers(slot: usize) -> Rc<RefCell<FiberPool<Script>>> {
    POOLS.with_borrow_mut(|pools| {
        let more = pools.len()..=slot;
        pools.extend(more.map(|_| Rc::default()));
        Rc::clone(&pools[slot])
    })
}

/// What an executor and the lanes of its slots tell each other.
#[derive(Default)]
pub(super) struct Aside {
    /// Slots whose callbacks its thread is in, each within the one before; those of none may not ask.
    entered: Vec<usize>,
    /// How often they asked.
    turns: usize,
    /// What the executor has to take up, in that order.
    news: VecDeque<(usize, Progress<Way>)>,
}

impl World {
    fn aside(&self, executor: usize) -> MutexGuard<'_, Aside> {
        self.asides[executor].try_lock().expect("one thread")
    }

    /// The callback of that slot is entered, or goes on: it may ask others at once.
    pub(super) fn enter(&self, executor: usize, slot: usize) {
        let mut aside = self.aside(executor);
        (aside.entered, aside.turns) = (vec![slot], 0);
    }

    /// It waits, or came to its end.
    pub(super) fn leave(&self, executor: usize) {
        self.aside(executor).entered.clear();
    }

    /// What came of a handler that was set aside.
    pub(super) fn take_news(&self, executor: usize) -> Option<(usize, Progress<Way>)> {
        self.aside(executor).news.pop_front()
    }

    /// True where that slot's handler can be entered by whoever asks here.
    pub(super) fn is_lane_open(&self, slot: usize, life: usize) -> bool {
        let model = self.model();
        let is_active = model.slots[slot].life == life && model.slots[slot].state == State::Active;
        let executor = model.slots[slot].executor;
        drop(model);
        let aside = self.aside(executor);
        let is_in = aside.entered.contains(&slot) || aside.news.iter().any(|(other, _)| *other == slot);
        let is_at_rest = is_active && !is_in && !self.waiting[slot].load(Ordering::Relaxed);
        let lets = !aside.entered.is_empty() && aside.turns < self.turns_at_once;
        let is_alone = !self.lanes_look || self.ends(slot).signal.alone_here().is_some();
        is_at_rest && lets && is_alone && self.is_thread_of(executor)
    }

    /// From now on the slot's handler can be entered at once, if there is that in this world.
    pub(super) fn furnish(self: &Arc<Self>, slot: usize) {
        if self.turns_at_once > 0 {
            let ends = self.ends(slot);
            let (executor, life) = (self.model().slots[slot].executor, ends.life);
            ends.providers[0].use_lane(Arc::new(Played { world: Arc::downgrade(self), slot, life, executor }));
        }
    }
}

/// A slot's lane, as long as it lives.
struct Played {
    world: Weak<World>,
    slot: usize,
    life: usize,
    executor: usize,
}

impl Lane for Played {
    fn is_open(&self) -> bool {
        self.world.upgrade().is_some_and(|world| world.is_lane_open(self.slot, self.life))
    }

    fn serve(&self, args: ServeArgs) -> Served {
        let (Some(world), Some(outer)) = (self.world.upgrade(), Outer::here(NEVER)) else { return Served::Not };
        // SAFETY: what a handler is shown stays while it is entered.
        let number = unsafe { *args.value.cast::<u64>() };
        if world.dice.once_in(32) {
            world.goes_by_inbox(number);
            return Served::Not;
        }
        world.enters_at_once(number, self.slot, args.id);
        let mut aside = world.aside(self.executor);
        if aside.entered.len() > 1 {
            world.count("at once within another");
        }
        aside.entered.push(self.slot);
        aside.turns += 1;
        drop(aside);
        let progress = self.run(&world, &outer, (args.id, number));
        world.aside(self.executor).entered.retain(|slot| *slot != self.slot);
        let served = progress.map_or(Served::Not, |progress| self.judge(&world, number, progress));
        world.leaves_at_once(number, served);
        served
    }
}

impl Played {
    /// The handler, until it waits or comes to its end. `None`: there is no fiber.
    fn run(&self, world: &Arc<World>, outer: &Outer, (id, number): (u64, u64)) -> Option<Progress<Way>> {
        let job = Job::Serve(id, number);
        let script = Script::new(world, self.slot, job);
        let pool = fibers(self.slot);
        let mut fiber = pool.borrow_mut().lend(STACK_BYTES).ok()?;
        fiber.furnish(|place| *place = Some(script));
        fiber.begin_within(outer, NEVER);
        let mut progress = pool.borrow_mut().take_back(fiber)?;
        loop {
            match progress {
                Progress::Waits(ticket, _) if world.take_gave_way() => {
                    world.count("at once, gave way");
                    world.set_gave_way(true);
                    if fiber::park(NEVER).is_err() {
                        world.wrong("who asks at once may wait".to_owned());
                    }
                    if world.dice.once_in(8) {
                        world.disturbs(number, self.executor);
                    }
                    progress = go_on_within(outer, self.slot, ticket)?;
                }
                progress => return Some(progress),
            }
        }
    }

    /// How far it got. What is not over, or left something, is taken up by the executor.
    fn judge(&self, world: &World, number: u64, progress: Progress<Way>) -> Served {
        let way = match &progress {
            Progress::Done(way) => Some(*way),
            Progress::Trapped(_) | Progress::Waits(..) => None,
        };
        // Now and then one that returned left something to be asked about.
        let is_clean = way == Some(Way::Returned) && !world.dice.once_in(16);
        if is_clean {
            world.count(match world.model().fate(number) {
                Some(Ok(_)) => "at once answered",
                Some(Err(_)) => "at once refused",
                None => "at once kept for later",
            });
            return Served::Done;
        }
        world.count(match way {
            Some(Way::Returned) => "set aside with a note",
            Some(Way::Panicked) => "set aside by a panic",
            Some(Way::Trapped) => "set aside by a trap",
            None => "set aside, waiting",
        });
        world.tell(|| format!("slot {}: is set aside", self.slot));
        world.aside(self.executor).news.push_back((self.slot, progress));
        Served::Aside
    }
}

/// Goes on with a handler that gave its thread up, on a fiber within the callback that asked.
struct Driver {
    slot: usize,
    ticket: Option<Ticket>,
    progress: Arc<Mutex<Option<Progress<Way>>>>,
}

impl Errand for Driver {
    type Report = ();

    fn run(&mut self) {
        let go_on = |ticket| fibers(self.slot).borrow_mut().go_on(ticket, NEVER, true);
        *self.progress.lock().expect("one thread") = self.ticket.take().and_then(go_on);
    }

    fn report(&self) {}
}

fn go_on_within(outer: &Outer, slot: usize, ticket: Ticket) -> Option<Progress<Way>> {
    let mut fiber = DRIVERS.with_borrow_mut(|drivers| drivers.lend(DRIVER_STACK_BYTES)).ok()?;
    let progress = Arc::default();
    let driver = Driver { slot, ticket: Some(ticket), progress: Arc::clone(&progress) };
    fiber.furnish(|place| *place = Some(driver));
    fiber.begin_within(outer, NEVER);
    DRIVERS.with_borrow_mut(|drivers| drivers.take_back_idle(fiber));
    progress.lock().expect("one thread").take()
}
