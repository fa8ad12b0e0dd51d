//! A slot as its executor sees it: instance, state, rules, standbys. Touched by the executor's thread only.

use std::collections::VecDeque;
use std::sync::Arc;

use component_sdk::abi::class::Hook;

use super::callback::{self, Call, Fibers};
use super::checkpoint::Checkpoint;
use super::follow::Chain;
use super::lane::{Aside, Lane};
use super::recover::Breath;
use super::service;
use super::silence::Watched;
use super::slot::Slot;
use super::strand::{Job, Pause, Strand};
use super::unit::Unit;
use super::workshop::Shelf;
use crate::detect::device::LostDevices;
use crate::model::fault::{Fault, FaultSender};
use crate::model::ladder::Ladder;
use crate::model::lifecycle::{Event, State};
use crate::model::limits::{TASK_END, TASK_END_AT_STOP};
use crate::model::time::nanoseconds;
use crate::port::pattern::provider::Openness;
use crate::profile::plan::{Coverage, Preload, Trigger};
use crate::sys::bell::{Ring, Rings, Signal};
use crate::sys::clock;

/// What an executor's members share.
pub struct Crew {
    /// Fibers of this thread.
    pub fibers: Fibers,
    /// To the fault manager.
    pub faults: FaultSender,
    /// When the last callback ended, as long as that is as good as now; 0: not known. To look takes as long as the way into
    /// a callback, so that the end of one is the beginning of the next.
    pub ended_ns: u64,
    ended_exactly: bool,
    /// When to look whether a consequence is still there; `u64::MAX`: none waits.
    pub(super) look_again_ns: u64,
    /// What lanes tell.
    pub(super) aside: Arc<Aside>,
}

impl Crew {
    /// Of the executor whose thread calls it.
    #[must_use]
    pub fn new(faults: FaultSender) -> Self {
        let (fibers, aside) = (Fibers::default(), Arc::default());
        Self { fibers, faults, ended_ns: 0, ended_exactly: false, look_again_ns: u64::MAX, aside }
    }

    /// When a callback that follows the last one at once begins: to the nanosecond, or to a tick.
    #[must_use]
    fn begins_ns(&mut self, exactly: bool) -> u64 {
        match std::mem::take(&mut self.ended_ns) {
            ended_ns if ended_ns != 0 && (self.ended_exactly || !exactly) => ended_ns,
            _ => now_ns(exactly),
        }
    }

    fn ends_ns(&mut self, exactly: bool) -> u64 {
        (self.ended_ns, self.ended_exactly) = (now_ns(exactly), exactly);
        self.ended_ns
    }
}

#[inline]
fn now_ns(exactly: bool) -> u64 {
    if exactly { clock::now_ns() } else { clock::recent_ns() }
}

/// A secondary of the slot.
pub struct Standby {
    /// How far it is prepared.
    pub preload: Preload,
    /// The instance, where it is prepared that far.
    pub unit: Option<Box<Unit>>,
}

/// A slot and all that only its executor touches.
pub struct Member {
    /// The slot.
    pub slot: Arc<Slot>,
    /// What wakes it.
    pub trigger: Trigger,
    /// Whether it is started at boot.
    pub autostart: bool,
    /// Marks it ready.
    pub signal: Arc<Signal>,
    /// How its instances are made, and those that are ready.
    pub shelf: Arc<Shelf>,
    /// The rules.
    pub ladder: Ladder,
    /// In how many nanoseconds it is to recover.
    pub recovery_within_ns: Option<u64>,
    /// Secondaries, in the ladder's order.
    pub standbys: Vec<Standby>,
    /// The instance; none after a fault-stop that lost it.
    pub unit: Option<Box<Unit>>,
    /// A spare at hand: it was made on another processor, and is to be near before it is needed.
    pub spare: Option<Box<Unit>>,
    /// Its callback that may wait.
    pub strand: Strand,
    /// It has run in this cycle of its executor.
    pub ran: bool,
    /// When the next period begins.
    pub next_due_ns: u64,
    /// Place in the order of data flow.
    pub rank: u32,
    /// Faults to provoke, one in each `on_execute`.
    pub inject: VecDeque<u8>,
    /// A fault that was raised while the instance was initialised or recovered; answered before it runs on.
    pub early: Option<Fault>,
    /// What a successor goes on from.
    pub checkpoint: Option<Checkpoint>,
    /// Its inputs whose silence is a fault.
    pub watched: Vec<Watched>,
    /// Devices of its component that are lost.
    pub lost_devices: LostDevices,
    /// A recovery that waits for its next try.
    pub breath: Option<Box<Breath>>,
    /// How far a fault-stop reaches.
    pub coverage: Coverage,
    /// Who may be the root of its faults; `None`: nobody.
    pub chain: Option<Box<Chain>>,
    /// Where its handlers are entered from within others' callbacks; `None`: it has none that are.
    pub lane: Option<Arc<Lane>>,
    /// When the emergency stop was latched that it heard last; 0: it heard none.
    pub stopped_us: u64,
}

/// Idle fibers kept for a member's size of stack: one runs, one is there when the first is lost.
const READY_FIBERS: usize = 2;

impl Member {
    /// Where it is in its lifecycle.
    #[must_use]
    pub fn state(&self) -> State {
        self.slot.status.state()
    }

    /// Takes an event's step in the lifecycle table; false: refused.
    pub fn step(&self, event: Event) -> bool {
        let next = self.state().after(event);
        if let Some(next) = next {
            self.slot.status.set_state(next);
        }
        next.is_some()
    }

    /// Creates and initialises the instance, and the standbys that are to be ready.
    ///
    /// # Errors
    /// The fault of a constructor or of `initialize`, and the class that it belongs to.
    pub fn install(&mut self, crew: &mut Crew) -> Result<(), String> {
        self.prepare_fibers(crew);
        let unit = self.make(0, crew).map_err(|fault| self.tell("instance", &fault))?;
        unit.open();
        self.unit = Some(unit);
        self.keep_side_report();
        self.step(Event::Initialize);
        for index in 0..self.standbys.len() {
            if self.standbys[index].preload == Preload::Instance {
                let unit = crew.prepare(&self.slot, self.shelf.recipe(index + 1));
                self.standbys[index].unit = Some(unit.map_err(|fault| self.tell("secondary", &fault))?);
                self.keep_side_report();
            }
        }
        self.furnish_checkpoint();
        self.shelf.order();
        Ok(())
    }

    fn tell(&self, what: &str, fault: &Fault) -> String {
        let (slot, symptom) = (self.slot.name, fault.symptom.name());
        format!("slot {slot}: its {what} cannot be initialised: {symptom}: {}", fault.evidence.text())
    }

    /// An initialised instance after the slot's recipe of that number.
    ///
    /// # Errors
    /// The fault of its constructor or of `initialize`.
    pub fn make(&self, number: usize, crew: &mut Crew) -> Result<Box<Unit>, Fault> {
        crew.make(&self.slot, self.shelf.recipe(number))
    }

    /// Enters a callback of the instance in use.
    ///
    /// # Errors
    /// The fault that ended it.
    pub fn enter(&mut self, call: Call<'_>, crew: &mut Crew) -> Result<(), Fault> {
        let Some(unit) = self.unit.as_mut() else { return Ok(()) };
        crew.enter(unit, call)
    }

    /// `start`: the slot becomes active.
    pub fn start(&mut self, crew: &mut Crew) {
        if !self.step(Event::Start) {
            return;
        }
        service::set_blocking(&self.slot, true);
        match self.start_instance(crew) {
            Ok(()) => {
                // What it registered by now is known before it is copied.
                self.furnish_checkpoint();
                self.answer_side_report(crew);
            }
            // Without a start it does not work: that waits for nobody.
            Err(fault) => self.handle_now(&fault, crew),
        }
        if self.state() == State::Active {
            self.begin();
        }
        self.answer_early(crew);
    }

    /// `start` of the instance in use.
    ///
    /// # Errors
    /// The fault that ended it.
    pub(super) fn enter_start(&mut self, crew: &mut Crew) -> Result<(), Fault> {
        self.enter(Call::plain(Hook::Start), crew)?;
        self.unit.iter_mut().for_each(|unit| unit.started = true);
        Ok(())
    }

    /// What was raised where it could not be answered: answered now, unless the slot has stopped meanwhile.
    fn answer_early(&mut self, crew: &mut Crew) {
        match self.early.take() {
            Some(fault) if self.state() == State::Active => self.handle(&fault, crew),
            Some(fault) => self.note(&fault, crew),
            None => {}
        }
    }

    /// Sets the next period, and looks at data that came before the start.
    pub fn begin(&mut self) {
        if let Trigger::Periodic(period) = self.trigger {
            let period = nanoseconds(period);
            // Multiples of the period: all members of one period begin together, on every executor.
            self.next_due_ns = (clock::now_ns() / period + 1) * period;
        }
        self.slot.outputs.iter().for_each(|port| port.forget_episodes());
        self.lost_devices.begin_anew();
        self.begin_to_watch();
        self.chain.iter_mut().for_each(|chain| chain.forget());
        let _ = self.signal.take();
        if self.trigger == Trigger::Nonperiodic && self.slot.inputs.iter().any(|port| port.has_data()) {
            self.signal.ring(Ring::Data);
        }
        service::set_open(&self.slot, Openness::Serving);
        // Values, and cycles of its own, that began while it did not work have rung for nobody.
        if self.has_to_serve() {
            self.signal.ring(Ring::Serve);
        }
    }

    /// True where a callback may be entered: what was raised before is answered first.
    pub(super) fn is_clear(&mut self, crew: &mut Crew) -> bool {
        if self.early.is_some() {
            self.answer_early(crew);
        }
        self.state() == State::Active
    }

    /// `on_execute`, with its outcome counted and a fault answered on the spot.
    pub fn execute(&mut self, crew: &mut Crew) {
        if !self.is_clear(crew) {
            return;
        }
        self.reach_for_spare();
        let inject = self.inject.pop_front().unwrap_or(0);
        let job = Job::Execute { queued: self.queued() };
        let call = self.call(Hook::Execute, crew).provoking(inject);
        // Looked at where it lies: a fault is large.
        let result = self.undertake(job, &call, crew);
        self.after(&result, call.now_ns, crew);
    }

    /// A callback that begins now. To look at the clock takes as long as the way into a callback and back: where no limit is
    /// near, a tick of the kernel will do, but for a sample of them.
    pub(super) fn call(&mut self, hook: Hook, crew: &mut Crew) -> Call<'static> {
        let exact = self.is_tight() || self.strand.is_sample() || matches!(self.trigger, Trigger::Periodic(_));
        self.strand.exact = exact;
        Call::at(hook, crew.begins_ns(exact)).within(self.slack_ns())
    }

    fn is_tight(&self) -> bool {
        self.unit.as_ref().is_none_or(|unit| unit.limits.is_tight())
    }

    /// By how much a moment may lie in the past.
    const fn slack_ns(&self) -> u64 {
        if self.strand.exact { 0 } else { clock::TICK_NS }
    }

    /// Goes on with the callback that waits.
    pub fn go_on(&mut self, crew: &mut Crew) {
        // Between its waits it may be a thousand times as often at work as it begins.
        self.strand.exact &= self.is_tight();
        let now_ns = crew.begins_ns(self.strand.exact);
        let result = self.resume(now_ns + self.slack_ns(), true, crew);
        self.after(&result, now_ns, crew);
    }

    /// Enters a callback that may wait.
    ///
    /// # Errors
    /// The fault that ended it.
    pub(super) fn undertake(&mut self, job: Job, call: &Call<'static>, crew: &mut Crew) -> Result<Pause, Fault> {
        self.strand.take_up(job);
        let Some(unit) = self.unit.as_mut() else { return Ok(Pause::Done) };
        crew.begin(unit, &mut self.strand, call)
    }

    fn resume(&mut self, begins_ns: u64, may_wait: bool, crew: &mut Crew) -> Result<Pause, Fault> {
        let Some(unit) = self.unit.as_mut() else { return Ok(Pause::Done) };
        crew.go_on(unit, &mut self.strand, begins_ns, may_wait)
    }

    /// What follows a stretch of a callback that may wait.
    pub(super) fn after(&mut self, result: &Result<Pause, Fault>, began_ns: u64, crew: &mut Crew) {
        let pause = match result {
            Ok(pause) => *pause,
            Err(fault) => return self.handle(fault, crew),
        };
        let away_ns = crew.aside.take_away_ns();
        // How long others ran on its time is known to a tick.
        self.strand.exact &= away_ns == 0;
        let took_ns = crew.ends_ns(self.strand.exact).saturating_sub(began_ns + away_ns);
        // It may have been a tick less: no component is said to be slower than it is.
        self.strand.ran_ns += took_ns.saturating_sub(self.slack_ns());
        match pause {
            Pause::Done => self.finish(self.strand.ran_ns, crew),
            // What was left is not its own: who ran on its time is looked at first.
            Pause::Waits if crew.aside.has_news() => {}
            // The next callback on this thread would erase it.
            Pause::Waits => self.keep_side_report(),
        }
    }

    fn finish(&mut self, took_ns: u64, crew: &mut Crew) {
        if self.strand.job == Job::Serve {
            return match callback::side_report() {
                Some(fault) => self.handle(&fault, crew),
                None => self.back_up(crew),
            };
        }
        self.completed(took_ns, crew);
        // It took one value of several: the others are news, too. One that takes nothing is not asked again.
        if let Job::Execute { queued } = self.strand.job
            && queued > 1
            && self.trigger == Trigger::Nonperiodic
            && (1..queued).contains(&self.queued())
        {
            self.signal.ring(Ring::Data);
        }
    }

    /// Whatever its callback waits for, it waits no longer: it is told so and comes to its end. One of an instance that is
    /// never entered again does not.
    pub(super) fn end_wait(&mut self, crew: &mut Crew) {
        if !self.strand.waits() {
            return;
        }
        if self.unit.as_ref().is_none_or(|unit| unit.spent) {
            self.strand.take_ticket().into_iter().for_each(|ticket| crew.fibers.abandon(ticket));
        } else if let Err(fault) = self.resume(clock::now_ns(), false, crew) {
            self.note(&fault, crew);
        } else {
            self.note_side_report(crew);
        }
        self.let_in();
    }

    /// Its callback is done, however it ended: what was rung for meanwhile is looked at, and the next request has its turn
    /// after all others that wait for this executor.
    pub(super) fn let_in(&mut self) {
        let held = self.strand.release();
        if !held.is_empty() {
            self.signal.ring_again(held);
        }
        if !self.slot.serves() {
            return;
        }
        let has_event = self.slot.events.settle();
        if has_event || self.has_to_serve() {
            self.signal.ring(Ring::Serve);
        }
    }

    /// Its handlers can be entered from within others' callbacks while it is at rest.
    #[inline]
    pub(super) fn offer(&self, crew: &mut Crew) {
        if let Some(lane) = &self.lane {
            self.offer_lane(lane, crew);
        }
    }

    fn offer_lane(&self, lane: &Lane, crew: &mut Crew) {
        let is_at_rest = self.state() == State::Active
            && self.early.is_none()
            && self.breath.is_none()
            && !self.strand.waits()
            // What a handler changed may be due for it.
            && self.checkpoint.is_none()
            // One of them may answer from its own thread.
            && self.slot.tasks.is_empty();
        match self.unit.as_ref().filter(|unit| is_at_rest && !unit.spent && !unit.limits.is_tight()) {
            Some(unit) => {
                if lane.open(unit, &crew.aside, &mut crew.fibers) {
                    // A recovery finds its own all the same.
                    self.prepare_fibers(crew);
                }
            }
            None => lane.close(),
        }
    }

    /// Takes up what a handler came to that was entered from within another callback.
    pub(super) fn take_up_aside(&mut self, crew: &mut Crew) {
        let Some(fiber) = self.lane.as_ref().and_then(|lane| lane.take_out()) else { return };
        let Some(unit) = self.unit.as_mut() else { return };
        self.strand.take_up(Job::Serve);
        self.strand.exact = false;
        let result = crew.take_up(unit, &mut self.strand, fiber);
        self.after(&result, clock::now_ns(), crew);
    }

    /// How long its callback may take that may ask others at once; `None`: it may not, for how long they take is not measured
    /// exactly.
    #[inline]
    pub(super) fn asks_at_once(&self) -> Option<u64> {
        self.unit.as_ref().filter(|unit| !unit.limits.is_tight()).map(|unit| unit.limits.hang_ns)
    }

    /// What somebody has to tell that is no reason to enter a callback.
    #[cold]
    pub(super) fn hear(&mut self, rings: Rings, crew: &mut Crew) {
        if rings.has(Ring::Emergency) {
            self.emergency_stop(crew);
        }
        if rings.has(Ring::Task) {
            self.hear_tasks(crew);
        }
        if rings.has(Ring::Charge) {
            self.hear_charges(crew);
        }
    }

    pub(super) fn queued(&self) -> usize {
        self.slot.inputs.iter().map(|port| port.queued()).sum()
    }

    fn completed(&mut self, took_ns: u64, crew: &mut Crew) {
        self.slot.status.count_cycle(took_ns);
        match callback::side_report() {
            Some(fault) => self.handle(&fault, crew),
            None => self.judge_time(took_ns, crew),
        }
    }

    /// An overrun, or a checkpoint where one is due: of an instance that works.
    fn judge_time(&mut self, took_ns: u64, crew: &mut Crew) {
        let limits = self.unit.as_ref().map(|unit| unit.limits);
        match limits.and_then(|limits| limits.late(took_ns)) {
            Some(fault) => self.handle(&fault, crew),
            None => self.back_up(crew),
        }
    }

    fn back_up(&mut self, crew: &mut Crew) {
        if self.checkpoint.as_mut().is_some_and(Checkpoint::is_due) {
            self.back_up_now(crew);
        }
    }

    pub(super) fn back_up_now(&mut self, crew: &mut Crew) {
        let (Some(checkpoint), Some(unit)) = (&mut self.checkpoint, &mut self.unit) else { return };
        if let Err(fault) = crew.back_up(unit, checkpoint) {
            self.handle(&fault, crew);
        }
    }

    /// `update`, at the end of a cycle.
    pub fn update(&mut self, crew: &mut Crew) {
        if self.state() != State::Active || self.strand.waits() {
            return;
        }
        match self.enter(Call::plain(Hook::Update), crew) {
            Ok(()) => self.answer_side_report(crew),
            Err(fault) => self.handle(&fault, crew),
        }
    }

    pub(super) fn answer_side_report(&mut self, crew: &mut Crew) {
        if let Some(fault) = callback::side_report() {
            self.handle(&fault, crew);
        }
    }

    /// `stop`: the slot becomes inactive.
    pub fn stop(&mut self, crew: &mut Crew) {
        self.give_up(crew);
        service::set_blocking(&self.slot, false);
        self.end_tasks(TASK_END_AT_STOP, crew);
        self.end_wait(crew);
        service::set_open(&self.slot, Openness::Stopped);
        if let Some(unit) = self.unit.take_if(|unit| unit.spent) {
            crew.dispose(&self.slot, unit);
        }
        if !self.step(Event::Stop) {
            return;
        }
        match self.enter(Call::plain(Hook::Stop), crew) {
            Ok(()) => self.note_side_report(crew),
            Err(fault) => self.lose(&fault, crew),
        }
    }

    /// `destroy`, then the drop of the instance and of its standbys.
    pub fn destroy(&mut self, crew: &mut Crew) {
        self.stop(crew);
        // Nothing follows from it any more, but it was so.
        self.hear_charges(crew);
        if self.step(Event::Destroy)
            && let Err(fault) = self.enter(Call::plain(Hook::Destroy), crew)
        {
            self.lose(&fault, crew);
        }
        if let Some(unit) = self.unit.take() {
            crew.dispose(&self.slot, unit);
        }
        self.lane.iter().for_each(|lane| lane.clear(&mut crew.fibers));
        let spare = self.put_spare_down();
        let standbys = std::mem::take(&mut self.standbys).into_iter().filter_map(|standby| standby.unit).chain(spare);
        for unit in standbys.chain(self.shelf.close()) {
            crew.end(&self.slot, unit);
        }
        crew.fibers.bury();
    }

    /// A fault on the way out: there is nothing left to recover.
    pub(super) fn lose(&mut self, fault: &Fault, crew: &mut Crew) {
        self.step(Event::Fault);
        self.end_tasks(TASK_END, crew);
        if let Some(unit) = self.unit.take_if(|unit| unit.spent) {
            crew.dispose(&self.slot, unit);
        }
        self.report_stop(fault, crew);
    }

    /// Sees to it that a recovery finds its fibers.
    pub fn prepare_fibers(&self, crew: &mut Crew) {
        for stack_bytes in self.shelf.stacks() {
            // Out of address space: the next callback says so.
            let _ = crew.fibers.prepare(stack_bytes, READY_FIBERS);
        }
    }
}
