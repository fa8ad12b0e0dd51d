//! What is: the slots, the executors' bells, the time; and what was found wrong.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};

use framework_daemon::port::registry::Registry;
use framework_daemon::port::wait::{NotHere, Place};
use framework_daemon::sys::bell::Bell;
use framework_daemon::sys::fiber;
use framework_daemon::sys::seat::{self, Owner};

use super::dice::Dice;
use super::ends::Ends;
use super::lane::Aside;
use super::links;
use super::model::{self, GATES, Gates, Model, PORTS, Slot, State};

/// Slots of a system, at most.
pub(super) const SLOTS_MAX: usize = 8;
/// Executors, at most.
pub(super) const EXECUTORS_MAX: usize = 3;
/// A wait that ends by what it waits for only.
pub(super) const NO_DEADLINE_NS: u64 = 7 * 24 * 3600 * 1_000_000_000;

/// A history's system.
pub(super) struct World {
    pub(super) dice: Dice,
    /// Waits have deadlines.
    pub(super) deadlines: bool,
    /// Calls that a client port may have open.
    pub(super) pending: usize,
    /// Questions that a callback may have answered at once; 0: this world has no lanes.
    pub(super) turns_at_once: usize,
    /// Lanes are open only while nobody at all is to be looked at, as the real ones; elsewhere it is the servers alone that see to the
    /// order of calls.
    pub(super) lanes_look: bool,
    /// Whose thread it is.
    here: AtomicUsize,
    /// By executor.
    pub(super) asides: Vec<Mutex<Aside>>,
    /// By slot: its callback waits.
    pub(super) waiting: Vec<AtomicBool>,
    pub(super) slots: Vec<Mutex<Arc<Ends>>>,
    pub(super) registry: Registry,
    pub(super) bells: Vec<Arc<Bell>>,
    /// Of the thread that belongs to no executor.
    pub(super) outside: Arc<Bell>,
    now_ns: AtomicU64,
    steps: AtomicU64,
    steps_max: u64,
    model: Mutex<Model>,
    problem: Mutex<Option<String>>,
    failed: AtomicBool,
    quiet: AtomicBool,
    gave_way: AtomicBool,
    told: Option<Mutex<Vec<String>>>,
    counts: Mutex<BTreeMap<&'static str, u64>>,
}

impl World {
    /// A small system drawn by lot, nothing of it connected or started; with its history written down or without.
    #[must_use]
    pub(super) fn new(seed: u64, steps_max: u64, tells: bool) -> Arc<Self> {
        let dice = Dice::new(seed);
        let executors = 1 + dice.below(EXECUTORS_MAX);
        let count = 2 + dice.below(SLOTS_MAX - 1);
        let mut world = Self {
            deadlines: dice.once_in(2),
            pending: 1 + dice.below(4),
            turns_at_once: dice.below(4),
            lanes_look: !dice.once_in(3),
            here: AtomicUsize::new(executors),
            asides: (0..executors).map(|_| Mutex::default()).collect(),
            waiting: (0..count).map(|_| AtomicBool::new(false)).collect(),
            slots: Vec::new(),
            registry: Registry::default(),
            bells: (0..executors).map(|_| Bell::new()).collect(),
            outside: Bell::new(),
            now_ns: AtomicU64::new(1_000),
            steps: AtomicU64::new(0),
            steps_max,
            model: Mutex::default(),
            problem: Mutex::default(),
            failed: AtomicBool::new(false),
            quiet: AtomicBool::new(false),
            gave_way: AtomicBool::new(false),
            told: tells.then(Mutex::default),
            counts: Mutex::default(),
            dice,
        };
        for _ in 0..count {
            let executor = world.dice.below(executors);
            let ends = world.build(executor);
            let slot = Slot {
                life: ends.life,
                executor,
                state: State::Stopped,
                links: [None; PORTS],
                gates: [Gates { slot: false, ..Gates::OPEN }; GATES],
                instance: model::Instance::default(),
                wait: None,
                at_once: None,
                ending: false,
            };
            ends.set_blocking(false);
            world.model().slots.push(slot);
            world.slots.push(Mutex::new(ends));
        }
        links::announce(&world);
        Arc::new(world)
    }

    /// The one thread is that executor's from now on, in a callback.
    pub(super) fn take_thread(&self, bell: &Arc<Bell>) {
        bell.adopt();
        let own = self.bells.iter().position(|other| Arc::ptr_eq(other, bell));
        self.here.store(own.unwrap_or(self.bells.len()), Ordering::Relaxed);
        let _ = seat::enter(&Owner { slot: "", instance: 1 });
    }

    /// The one thread is that executor's.
    pub(super) fn is_thread_of(&self, executor: usize) -> bool {
        self.here.load(Ordering::Relaxed) == executor
    }

    /// The ends of a slot now.
    ///
    /// # Panics
    /// Never: one thread.
    #[must_use]
    pub(super) fn ends(&self, slot: usize) -> Arc<Ends> {
        Arc::clone(&self.slots[slot].try_lock().expect("one thread"))
    }

    /// The model. Not to be held over a wait.
    ///
    /// # Panics
    /// When it is: one thread.
    pub(super) fn model(&self) -> MutexGuard<'_, Model> {
        self.model.try_lock().expect("one thread, which holds it over no wait")
    }

    /// The time.
    #[must_use]
    pub(super) fn now_ns(&self) -> u64 {
        self.now_ns.load(Ordering::Relaxed)
    }

    /// Sets the time, which does not go back.
    pub(super) fn advance_to(&self, now_ns: u64) {
        self.now_ns.fetch_max(now_ns, Ordering::Relaxed);
    }

    /// Takes a step; false: there were enough, or something is wrong.
    pub(super) fn step(&self) -> bool {
        self.goes_on() && {
            self.steps.fetch_add(1, Ordering::Relaxed);
            true
        }
    }

    /// True as long as nothing is wrong and there are steps left.
    #[must_use]
    pub(super) fn goes_on(&self) -> bool {
        self.is_right() && self.steps() < self.steps_max
    }

    /// True as long as nothing is wrong.
    #[must_use]
    pub(super) fn is_right(&self) -> bool {
        !self.failed.load(Ordering::Relaxed)
    }

    /// Callbacks come to their ends and begin nothing.
    #[must_use]
    pub(super) fn is_quiet(&self) -> bool {
        self.quiet.load(Ordering::Relaxed)
    }

    /// Says whether they do.
    pub(super) fn set_quiet(&self, quiet: bool) {
        self.quiet.store(quiet, Ordering::Relaxed);
    }

    /// The callback that is suspended does not wait: its thread is another one's for some time.
    pub(super) fn set_gave_way(&self, gave_way: bool) {
        self.gave_way.store(gave_way, Ordering::Relaxed);
    }

    /// True where the last one that was suspended does not wait.
    #[must_use]
    pub(super) fn take_gave_way(&self) -> bool {
        self.gave_way.swap(false, Ordering::Relaxed)
    }

    /// Steps so far.
    #[must_use]
    pub(super) fn steps(&self) -> u64 {
        self.steps.load(Ordering::Relaxed)
    }

    /// Writes a step down.
    ///
    /// # Panics
    /// Never: one thread.
    pub(super) fn tell(&self, text: impl FnOnce() -> String) {
        if let Some(told) = &self.told {
            let line = format!("{:6} {:>9}  {}", self.steps(), self.now_ns(), text());
            told.try_lock().expect("one thread").push(line);
        }
    }

    /// Counts something that happened.
    ///
    /// # Panics
    /// Never: one thread.
    pub(super) fn count(&self, what: &'static str) {
        *self.counts.try_lock().expect("one thread").entry(what).or_default() += 1;
    }

    /// Something is wrong: the history ends here.
    ///
    /// # Panics
    /// Never: one thread.
    pub(super) fn wrong(&self, text: String) {
        self.tell(|| format!("WRONG: {text}"));
        self.problem.try_lock().expect("one thread").get_or_insert(text);
        self.failed.store(true, Ordering::Relaxed);
    }

    /// Something is wrong unless both are the same.
    #[allow(clippy::needless_pass_by_value, reason = "what is compared is made for it")]
    pub(super) fn same<T: PartialEq + std::fmt::Debug>(&self, what: impl FnOnce() -> String, is: T, must: T) {
        if is != must {
            self.wrong(format!("{}: {is:?} instead of {must:?}", what()));
        }
    }

    /// What was found, what was written down, what was counted.
    ///
    /// # Panics
    /// Never: one thread.
    pub(super) fn findings(&self) -> (Option<String>, Vec<String>, BTreeMap<&'static str, u64>) {
        let told = self.told.as_ref().map(|told| std::mem::take(&mut *told.try_lock().expect("one thread")));
        let problem = self.problem.try_lock().expect("one thread").take();
        (problem, told.unwrap_or_default(), std::mem::take(&mut *self.counts.try_lock().expect("one thread")))
    }
}

/// A wait in a history: its fiber waits, its time is the history's.
pub(super) struct Here<'a> {
    pub(super) world: &'a World,
    pub(super) slot: usize,
    /// It did wait.
    pub(super) waited: AtomicBool,
}

impl Place for Here<'_> {
    fn now_ns(&self) -> u64 {
        self.world.now_ns()
    }

    fn park(&self, until_ns: u64) -> Result<(), NotHere> {
        if self.world.is_set_aside(self.slot) {
            self.world.same(|| "until when who asked at once waits".to_owned(), until_ns, self.now_ns());
            let parked = fiber::park(until_ns);
            self.world.begin_to_wait(self.slot);
            return parked;
        }
        self.waited.store(true, Ordering::Relaxed);
        fiber::park(until_ns)
    }
}
