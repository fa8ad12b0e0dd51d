//! Who runs next: the executors' loops, as `exec::executor` and `exec::member` have them, one stretch of a callback at a
//! time.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use framework_daemon::sys::bell::{Ring, Rings};
use framework_daemon::sys::fiber::NEVER;
use framework_daemon::sys::fiber_pool::{Progress, Ticket};

use super::lane::{self, STACK_BYTES};
use super::model::State;
use super::script::{Job, Script, Way};
use super::world::World;

/// What an executor does at most so that its slots are at rest.
const CALM: usize = 16;

/// A slot's callback that may wait.
#[derive(Default)]
pub(super) struct Strand {
    waiting: Option<(Ticket, u64)>,
    /// What was rung for meanwhile.
    held: Rings,
}

/// An executor.
#[derive(Default)]
struct Executor {
    /// Its thread is in the middle of a callback of this slot, and another thread runs.
    busy: Option<(usize, Ticket)>,
}

/// All that run.
pub(super) struct Executors {
    pub(super) world: Arc<World>,
    executors: Vec<Executor>,
    strands: Vec<Strand>,
    /// The callback that came to its end last did so by a trap.
    pub(super) was_lost: bool,
}

impl Executors {
    /// Those of that world.
    #[must_use]
    pub(super) fn new(world: &Arc<World>) -> Self {
        let executors = world.bells.iter().map(|_| Executor::default()).collect();
        let strands = world.slots.iter().map(|_| Strand::default()).collect();
        Self { world: Arc::clone(world), executors, strands, was_lost: false }
    }

    pub(super) fn executor(&self, slot: usize) -> usize {
        self.world.model().slots[slot].executor
    }

    pub(super) fn state(&self, slot: usize) -> State {
        self.world.model().slots[slot].state
    }

    /// Its executor's thread is not in the middle of a callback.
    pub(super) fn is_free(&self, slot: usize) -> bool {
        self.executors[self.executor(slot)].busy.is_none()
    }

    /// Its callback waits.
    pub(super) fn waits(&self, slot: usize) -> bool {
        self.strands[slot].waiting.is_some()
    }

    /// Until when.
    pub(super) fn until_ns(&self, slot: usize) -> Option<u64> {
        self.strands[slot].waiting.as_ref().map(|(_, until_ns)| *until_ns)
    }

    /// An executor does one thing; false: it has nothing to do.
    pub(super) fn run(&mut self, executor: usize) -> bool {
        self.world.take_thread(&self.world.bells[executor]);
        if let Some((slot, ticket)) = self.executors[executor].busy.take() {
            let progress = lane::fibers(slot).borrow_mut().go_on(ticket, NEVER, true);
            self.settle(slot, progress);
            return true;
        }
        let Some(life) = self.world.bells[executor].next_ready() else { return false };
        let slot = self.world.model().slots.iter().position(|slot| slot.life == life);
        if let Some(slot) = slot {
            self.look(slot);
        }
        true
    }

    /// Looks at a slot that was rung for.
    fn look(&mut self, slot: usize) {
        let rings = self.world.ends(slot).signal.take();
        let strand = &mut self.strands[slot];
        if strand.waiting.is_some() {
            strand.held = strand.held.and(rings.without(Ring::Wait));
            if rings.has(Ring::Wait) {
                self.go_on(slot, true);
            }
            return;
        }
        if rings.has(Ring::Serve) && self.state(slot) == State::Active {
            self.serve(slot);
        }
    }

    /// A period begins; false: not now.
    pub(super) fn execute(&mut self, slot: usize) -> bool {
        if self.world.turns_at_once > 0 && self.world.dice.once_in(2) {
            // Then those that it asks are at rest.
            self.calm(self.executor(slot));
        }
        let is_idle = self.state(slot) == State::Active && !self.waits(slot) && self.is_free(slot);
        if is_idle {
            self.begin(slot, Job::Execute);
        }
        is_idle
    }

    /// An executor does all that there is to do, for some time.
    fn calm(&mut self, executor: usize) {
        for _ in 0..CALM {
            if !self.world.step() || !self.run(executor) {
                return;
            }
        }
    }

    pub(super) fn begin(&mut self, slot: usize, job: Job) {
        let executor = self.executor(slot);
        self.world.take_thread(&self.world.bells[executor]);
        let script = Script::new(&self.world, slot, job);
        self.world.enter(executor, slot);
        let begun = lane::fibers(slot).borrow_mut().begin(STACK_BYTES, NEVER, true, |place| *place = Some(script));
        match begun {
            Ok(progress) => self.settle(slot, Some(progress)),
            Err(error) => self.world.wrong(format!("no fiber: {error}")),
        }
    }

    /// Goes on with a callback that waits; where it may not wait any more, it comes to its end.
    pub(super) fn go_on(&mut self, slot: usize, may_wait: bool) {
        let executor = self.executor(slot);
        self.world.take_thread(&self.world.bells[executor]);
        let Some(ticket) = self.take_ticket(slot) else { return };
        if may_wait {
            self.world.enter(executor, slot);
        }
        let progress = lane::fibers(slot).borrow_mut().go_on(ticket, NEVER, may_wait);
        self.settle(slot, progress);
    }

    /// Nobody will go on with it.
    pub(super) fn abandon(&mut self, slot: usize) {
        if let Some(ticket) = self.take_ticket(slot) {
            let fibers = lane::fibers(slot);
            fibers.borrow_mut().abandon(ticket);
            fibers.borrow_mut().bury();
        }
    }

    fn take_ticket(&mut self, slot: usize) -> Option<Ticket> {
        self.world.waiting[slot].store(false, Ordering::Relaxed);
        self.strands[slot].waiting.take().map(|(ticket, _)| ticket)
    }

    /// What follows a stretch of a callback, and then what was entered from within it and is to be taken up.
    fn settle(&mut self, slot: usize, progress: Option<Progress<Way>>) {
        let executor = self.executor(slot);
        match progress {
            Some(Progress::Waits(ticket, _)) if self.world.take_gave_way() => {
                self.executors[executor].busy = Some((slot, ticket));
                return;
            }
            progress => {
                self.world.leave(executor);
                self.conclude(slot, progress);
            }
        }
        while let Some((slot, progress)) = self.world.take_news(executor) {
            self.conclude(slot, Some(progress));
        }
    }

    fn conclude(&mut self, slot: usize, progress: Option<Progress<Way>>) {
        match progress {
            Some(Progress::Waits(ticket, until_ns)) => {
                self.world.waiting[slot].store(true, Ordering::Relaxed);
                self.strands[slot].waiting = Some((ticket, until_ns));
            }
            Some(Progress::Done(way)) => self.ended(slot, way),
            Some(Progress::Trapped(_)) | None => self.world.wrong(format!("the fiber of slot {slot} is gone")),
        }
    }

    fn ended(&mut self, slot: usize, way: Way) {
        // Where it stops, whoever stops it sees to the rest.
        if way == Way::Trapped {
            self.trapped(slot);
        }
        self.let_in(slot);
    }

    /// It waits no longer: what was rung for meanwhile is looked at, and what is to be served has its turn.
    pub(super) fn let_in(&mut self, slot: usize) {
        let (held, ends) = (std::mem::take(&mut self.strands[slot].held), self.world.ends(slot));
        ends.signal.ring_again(held);
        let mut model = self.world.model();
        if let Some(told) = model.tellers[ends.life].told.take() {
            model.put_down(told);
        }
        drop(model);
        if ends.events.settle() || ends.has_to_serve() {
            ends.signal.ring(Ring::Serve);
        }
    }

    /// All executors do what there is to do, and callbacks begin nothing.
    pub(super) fn come_to_rest(&mut self) {
        self.world.set_quiet(true);
        while self.world.is_right() && (0..self.executors.len()).any(|executor| self.run(executor)) {}
        self.world.set_quiet(false);
    }
}
