//! Who runs next: the executors' loops, as `exec::executor` and `exec::member` have them, one stretch of a callback at a
//! time.

use std::sync::Arc;

use framework_daemon::sys::bell::{Ring, Rings};
use framework_daemon::sys::fiber::NEVER;
use framework_daemon::sys::fiber_pool::{FiberPool, Progress, Ticket};

use super::model::State;
use super::script::{Job, Script, Way};
use super::world::World;

const STACK_BYTES: usize = 256 << 10;

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
    fibers: FiberPool<Script>,
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
            let progress = self.executors[executor].fibers.go_on(ticket, NEVER, true);
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
        let is_idle = self.state(slot) == State::Active && !self.waits(slot) && self.is_free(slot);
        if is_idle {
            self.begin(slot, Job::Execute);
        }
        is_idle
    }

    pub(super) fn begin(&mut self, slot: usize, job: Job) {
        let executor = self.executor(slot);
        self.world.take_thread(&self.world.bells[executor]);
        let (world, ends) = (Arc::clone(&self.world), self.world.ends(slot));
        let script = Box::new(Script { world, slot, ends, job, way: Way::Returned });
        match self.executors[executor].fibers.begin(STACK_BYTES, NEVER, true, script) {
            Ok(progress) => self.settle(slot, Some(progress)),
            Err(error) => self.world.wrong(format!("no fiber: {error}")),
        }
    }

    /// Goes on with a callback that waits; where it may not wait any more, it comes to its end.
    pub(super) fn go_on(&mut self, slot: usize, may_wait: bool) {
        let executor = self.executor(slot);
        self.world.take_thread(&self.world.bells[executor]);
        let Some((ticket, _)) = self.strands[slot].waiting.take() else { return };
        let progress = self.executors[executor].fibers.go_on(ticket, NEVER, may_wait);
        self.settle(slot, progress);
    }

    /// Nobody will go on with it.
    pub(super) fn abandon(&mut self, slot: usize) {
        let executor = self.executor(slot);
        if let Some((ticket, _)) = self.strands[slot].waiting.take() {
            self.executors[executor].fibers.abandon(ticket);
            self.executors[executor].fibers.bury();
        }
    }

    fn settle(&mut self, slot: usize, progress: Option<Progress<Script>>) {
        let executor = self.executor(slot);
        match progress {
            Some(Progress::Waits(ticket, until_ns)) => {
                if self.world.take_gave_way() {
                    self.executors[executor].busy = Some((slot, ticket));
                } else {
                    self.strands[slot].waiting = Some((ticket, until_ns));
                }
            }
            Some(Progress::Done(script)) => self.ended(slot, script.way),
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
