//! The local answer to a fault, on the thread that saw it, from the table compiled at load: reset, replace or stop, at
//! once. The fault manager learns of it afterwards.
//!
//! The alternative, a manager thread that decides, costs a hand-over: 22 ms at p99.9 with all cores busy.

use std::sync::atomic::{AtomicU64, Ordering};

use abi_stable::std_types::RStr;
use component_sdk::abi::class::{FaultArgs, Hook};

use super::callback::{self, Call};
use super::checkpoint::Checkpoint;
use super::emergency;
use super::member::{Crew, Member};
use super::service;
use super::slot::Status;
use super::strand::{Job, Last, Pause};
use super::unit::Unit;
use crate::model::chain;
use crate::model::fault::{Evidence, Fault, FaultEvent, FaultSender, Outcome, Stage, Times};
use crate::model::ladder::Answer;
use crate::model::lifecycle::{Event, State};
use crate::model::limits::{BREATH_MAX, BREATH_MIN, BREATHLESS_FAILURES, RECOVERY_STEPS_MAX, TASK_END};
use crate::model::symptom::{Severity, Symptom};
use crate::model::time::nanoseconds;
use crate::port::charge;
use crate::port::pattern::provider::Openness;
use crate::profile::plan::{Coverage, Trigger};
use crate::sys::bell::Ring;
use crate::sys::clock;

static LOST: AtomicU64 = AtomicU64::new(0);

/// Fault events that found the fault manager's queue full, or that of the slot which they charge.
#[must_use]
pub fn lost_events() -> u64 {
    LOST.load(Ordering::Relaxed) + charge::lost()
}

/// How one step of the ladder ended. Small, because a fault is large and a step that holds returns none; that of a step
/// that failed is in [`Climb::second`].
#[derive(Clone, Copy, PartialEq, Eq)]
enum Step {
    /// The slot works.
    Works,
    /// The slot is stopped.
    Stopped,
    /// The recovery failed itself.
    Failed,
}

/// A way up the ladder: where it began and how far it got.
pub struct Climb {
    /// Class of the instance that failed first.
    class: &'static str,
    /// The step that is tried next.
    answer: Answer,
    /// What the last failed try ended with.
    second: Option<Fault>,
    failures: usize,
    record: Record,
}

/// What is written down of it.
#[derive(Clone, Copy, Default)]
struct Record {
    /// When the answer was looked up, as long as that is as good as now; 0 afterwards.
    decided_at_ns: u64,
    times: Times,
    /// Age of the checkpoint that the successor went on from.
    checkpoint_ns: Option<u64>,
    /// Slot whose fault it is left to.
    cause: Option<&'static str>,
}

/// A recovery that failed more than once: the next try waits, and the executor runs its other slots meanwhile.
pub struct Breath {
    fault: Fault,
    climb: Climb,
    until_ns: u64,
}

impl Climb {
    /// The step failed by that fault.
    fn fail(&mut self, second: Fault) -> Step {
        self.second = Some(second);
        Step::Failed
    }

    /// What the next step is told: the last failed try, or the fault itself.
    fn cause<'a>(&'a self, fault: &'a Fault) -> &'a Fault {
        self.second.as_ref().unwrap_or(fault)
    }
}

impl Record {
    fn begin(fault: &Fault) -> Self {
        let decided_at_ns = clock::now_ns();
        let decided_ns = decided_at_ns.saturating_sub(fault.at_ns);
        Self { decided_at_ns, times: Times { decided_ns, ..Times::default() }, ..Self::default() }
    }
}

impl Breath {
    /// When the next try is due.
    #[must_use]
    pub const fn until_ns(&self) -> u64 {
        self.until_ns
    }
}

impl Member {
    /// Answers a fault of this slot.
    pub fn handle(&mut self, fault: &Fault, crew: &mut Crew) {
        if fault.stage != Stage::Confirmed {
            self.note_end(fault);
            return self.note(fault, crew);
        }
        if !chain::may_follow(fault.symptom) || !self.leaves(fault, crew) {
            self.handle_now(fault, crew);
        }
    }

    /// Answers a fault that waits for nobody else's.
    pub(super) fn handle_now(&mut self, fault: &Fault, crew: &mut Crew) {
        if !chain::may_follow(fault.symptom) {
            self.slot.charges.take_up(fault.symptom, fault.at_ns);
        }
        self.answer(fault, crew);
        // That took its time.
        crew.ended_ns = 0;
    }

    fn answer(&mut self, fault: &Fault, crew: &mut Crew) {
        // What is entered from here on asks nobody at once: its answer is given first.
        crew.aside.leave();
        if self.ladder.severity(fault.symptom) == Severity::Emergency {
            emergency::raise(self.slot.name, fault.at_ns);
        }
        // Where something else than the callback failed, it may be waiting.
        self.end_wait(crew);
        if self.unit.as_ref().is_some_and(|unit| unit.spent) {
            self.end_tasks(TASK_END, crew);
        }
        Status::count(&self.slot.status.faults);
        let class = self.slot.status.class();
        let answer = self.look_up(fault);
        let record = Record::begin(fault);
        if answer == Answer::Ignore {
            self.tell_manager(fault, class, answer, Outcome::Ignored, record, crew);
            return;
        }
        self.step(Event::Fault);
        self.slot.outputs.iter().for_each(|port| port.forget_episodes());
        self.lost_devices.begin_anew();
        self.climb(fault, Climb { class, answer, second: None, failures: 0, record }, crew);
    }

    /// An instance that cannot be entered again cannot be ignored either.
    fn look_up(&mut self, fault: &Fault) -> Answer {
        match self.ladder.answer(fault.symptom, fault.detected_ns) {
            Answer::Ignore if fault.symptom.loses_instance() => Answer::Stop,
            answer => answer,
        }
    }

    /// Walks the ladder until a step holds. A step that fails is followed by a further one, never by the same; the first
    /// further one at once, the others after a pause: nothing loops, and commands and other slots have their turn.
    fn climb(&mut self, fault: &Fault, mut climb: Climb, crew: &mut Crew) {
        let mut late = None;
        loop {
            let step = match climb.answer {
                Answer::Reset => self.reset(fault, &mut climb, crew),
                Answer::Replace => self.replace(fault, &mut climb, crew),
                Answer::Stop | Answer::Emergency | Answer::Ignore | Answer::Await | Answer::Prepare => {
                    self.fault_stop(climb.cause(fault), crew)
                }
            };
            let Climb { class, answer, record, .. } = climb;
            match step {
                Step::Works => {
                    late = self.judge_recovery(fault, &record.times);
                    self.tell_manager(fault, class, answer, Outcome::Recovered, record, crew);
                }
                Step::Stopped => {
                    let answer = self.raise_what_follows(answer, fault);
                    self.tell_manager(fault, class, answer, Outcome::Stopped, record, crew);
                }
                Step::Failed => {
                    self.count_failure(&mut climb, crew);
                    if climb.answer == Answer::Stop || climb.failures <= BREATHLESS_FAILURES {
                        continue;
                    }
                    self.breathe(fault, climb, crew);
                }
            }
            break;
        }
        // What had arrived for the callback that failed, and was not taken, rings no more by itself.
        if self.state() == State::Active && self.trigger == Trigger::Nonperiodic && self.queued() > 0 {
            self.signal.ring(Ring::Data);
        }
        crew.fibers.bury();
        self.prepare_fibers(crew);
        self.shelf.order();
        if let Some(late) = late {
            self.answer(&late, crew);
        }
    }

    /// Holds a recovery against what the profile declares; the fault of one that took longer. That of a fault that was one
    /// itself is not judged: nothing loops.
    fn judge_recovery(&self, fault: &Fault, times: &Times) -> Option<Fault> {
        let took_ns = times.first_callback_ns.or(times.ready_ns)?;
        let declared_ns = self.recovery_within_ns.filter(|declared_ns| took_ns > *declared_ns);
        let declared_ns = declared_ns.filter(|_| fault.symptom != Symptom::Late);
        self.slot.status.recovery.note(took_ns, declared_ns.is_some());
        let evidence = Evidence::Recovery { took_ns, declared_ns: declared_ns? };
        // It happened when the time was over.
        let at_ns = fault.at_ns.saturating_add(declared_ns?);
        Some(Fault { at_ns, injected: fault.injected, ..Fault::told(Symptom::Late, clock::now_ns(), evidence) })
    }

    /// A fault-stop that covers the whole system is an emergency as well; returns what it is called.
    fn raise_what_follows(&self, answer: Answer, fault: &Fault) -> Answer {
        match answer {
            Answer::Emergency => Answer::Emergency,
            _ if self.coverage == Coverage::System => {
                emergency::raise(self.slot.name, fault.at_ns);
                Answer::Emergency
            }
            _ => Answer::Stop,
        }
    }

    /// A recovery failed itself: the ladder goes on.
    fn count_failure(&mut self, climb: &mut Climb, crew: &Crew) {
        Status::count(&self.slot.status.faults);
        if let Some(second) = &climb.second {
            let class = self.slot.status.class();
            self.tell_manager(second, class, climb.answer, Outcome::Failed, Record::default(), crew);
        }
        climb.answer = if climb.failures < RECOVERY_STEPS_MAX { self.ladder.further() } else { Answer::Stop };
        climb.failures += 1;
    }

    /// The next try waits, longer each time.
    fn breathe(&mut self, fault: &Fault, climb: Climb, crew: &mut Crew) {
        self.end_tasks(TASK_END, crew);
        // Nobody is to wait for an instance that is gone as long as that takes.
        service::change_hands(&self.slot);
        let doublings = (climb.failures - BREATHLESS_FAILURES).min(16) as u32 - 1;
        let pause = BREATH_MIN.saturating_mul(1 << doublings).min(BREATH_MAX);
        let until_ns = clock::now_ns() + nanoseconds(pause);
        self.breath = Some(Box::new(Breath { fault: *fault, climb, until_ns }));
    }

    /// The pause after a failed recovery is over.
    pub fn breathe_out(&mut self, crew: &mut Crew) {
        let Some(breath) = self.breath.take() else { return };
        self.climb(&breath.fault, breath.climb, crew);
        if self.state() == State::Active {
            self.begin();
        }
    }

    /// A stop wins over a recovery that waits for its next try.
    pub(super) fn give_up(&mut self, crew: &Crew) {
        if let Some(breath) = self.breath.take() {
            let Climb { class, record, .. } = breath.climb;
            self.tell_manager(&breath.fault, class, Answer::Stop, Outcome::Stopped, record, crew);
        }
    }

    /// The same instance where it is sound; a spare or, where none is ready, a fresh one of its class else.
    fn reset(&mut self, fault: &Fault, climb: &mut Climb, crew: &mut Crew) -> Step {
        if self.unit.as_ref().is_none_or(|unit| unit.spent) {
            let number = self.shelf.in_use();
            let spare = self.take_spare();
            return self.succeed_by(spare, number, fault, climb, crew);
        }
        for hook in [Hook::Error, Hook::Reset] {
            let args = told(self.slot.name, climb.cause(fault));
            if let Err(second) = self.enter(Call::plain(hook).telling(args), crew) {
                return climb.fail(second);
            }
            self.keep_side_report();
        }
        self.step(Event::Reset);
        if self.unit.as_ref().is_some_and(|unit| !unit.started)
            && let Err(second) = self.enter_start(crew)
        {
            self.step(Event::Fault);
            return climb.fail(second);
        }
        self.keep_side_report();
        self.put_to_work(fault, climb, crew)
    }

    /// The next secondary.
    fn replace(&mut self, fault: &Fault, climb: &mut Climb, crew: &mut Crew) -> Step {
        let Some(index) = self.ladder.secondary() else { return self.fault_stop(climb.cause(fault), crew) };
        let ready = self.standbys[index].unit.take();
        self.shelf.follow(index + 1);
        if let Some(spare) = self.put_spare_down() {
            self.clear(spare, crew);
        }
        self.succeed_by(ready, index + 1, fault, climb, crew)
    }

    /// A successor that is ready, or one that is made on the spot after the recipe of that number.
    fn succeed_by(
        &mut self,
        ready: Option<Box<Unit>>,
        number: usize,
        fault: &Fault,
        climb: &mut Climb,
        crew: &mut Crew,
    ) -> Step {
        if let Some(unit) = ready {
            return self.succeed(unit, fault, climb, crew);
        }
        climb.record.decided_at_ns = 0;
        match self.make(number, crew) {
            Ok(unit) => self.succeed(unit, fault, climb, crew),
            Err(second) => climb.fail(second),
        }
    }

    /// Puts a successor in the place of the instance in use.
    fn succeed(&mut self, unit: Box<Unit>, fault: &Fault, climb: &mut Climb, crew: &mut Crew) -> Step {
        self.end_tasks(TASK_END, crew);
        self.slot.status.set_class(unit.recipe);
        self.unit.iter().for_each(|unit| unit.close());
        service::change_hands(&self.slot);
        unit.open();
        let old = self.unit.replace(unit);
        let step = match self.restore(crew) {
            Ok(age_ns) => {
                climb.record.checkpoint_ns = age_ns;
                self.take_over(fault, climb, crew)
            }
            Err(second) => climb.fail(second),
        };
        if step == Step::Failed && climb.record.checkpoint_ns.take().is_some() {
            self.checkpoint.iter_mut().for_each(Checkpoint::forget);
        }
        // The old one's end is nobody's hurry.
        if let Some(old) = old {
            self.clear(old, crew);
        }
        step
    }

    /// The successor goes on from the slot's checkpoint.
    pub(super) fn restore(&mut self, crew: &mut Crew) -> Result<Option<u64>, Fault> {
        match (&self.checkpoint, &mut self.unit) {
            (Some(checkpoint), Some(unit)) => crew.restore(unit, checkpoint),
            _ => Ok(None),
        }
    }

    /// Leaves a unit to the workshop.
    pub(super) fn clear(&self, unit: Box<Unit>, crew: &mut Crew) {
        if unit.spent {
            Status::count(&self.slot.status.quarantined);
        }
        if let Err(unit) = self.shelf.clear(unit) {
            crew.end(&self.slot, unit);
        }
    }

    fn take_over(&mut self, fault: &Fault, climb: &mut Climb, crew: &mut Crew) -> Step {
        let now_ns = std::mem::take(&mut climb.record.decided_at_ns);
        let cause = climb.cause(fault);
        if let Some(args) = told_for_good(self.slot.name, cause) {
            let call = Call::at(Hook::Recover, now_ns).telling(args);
            return self.take_over_at_once(call, fault, climb, crew);
        }
        let call = Call::at(Hook::Recover, now_ns).telling(told(self.slot.name, cause));
        if let Err(second) = self.enter(call, crew) {
            return climb.fail(second);
        }
        self.keep_side_report();
        self.step(Event::Recover);
        self.step(Event::Start);
        if let Err(second) = self.enter_start(crew) {
            self.step(Event::Fault);
            return climb.fail(second);
        }
        self.keep_side_report();
        self.put_to_work(fault, climb, crew)
    }

    /// The same in one go: what the successor is told need not be kept for it.
    fn take_over_at_once(&mut self, call: Call<'static>, fault: &Fault, climb: &mut Climb, crew: &mut Crew) -> Step {
        self.step(Event::Recover);
        self.step(Event::Start);
        let executes = self.trigger != Trigger::Passive;
        self.strand.forget();
        let result = self.undertake(Job::Succeed { executes }, &call.timed(), crew);
        self.keep_side_report();
        let last = self.strand.last();
        let times = &mut climb.record.times;
        match result {
            Ok(pause) if executes => {
                let last = last.unwrap_or_else(Last::waiting);
                times.ready_ns = Some(last.began_ns.saturating_sub(fault.at_ns));
                if pause == Pause::Done {
                    times.first_callback_ns = Some(last.ended_ns.saturating_sub(fault.at_ns));
                    self.slot.status.count_cycle(0);
                }
            }
            Ok(_) => times.ready_ns = Some(since(fault)),
            Err(second) => {
                self.step(Event::Fault);
                self.unit
                    .iter_mut()
                    .for_each(|unit| unit.started = last.is_some_and(|last| last.hook == Hook::Execute));
                return climb.fail(second);
            }
        }
        self.unit.iter_mut().for_each(|unit| unit.started = true);
        Step::Works
    }

    /// The callback that the fault cut short, again.
    fn put_to_work(&mut self, fault: &Fault, climb: &mut Climb, crew: &mut Crew) -> Step {
        let now_ns = clock::now_ns();
        climb.record.times.ready_ns = Some(now_ns.saturating_sub(fault.at_ns));
        if self.trigger == Trigger::Passive {
            return Step::Works;
        }
        match self.undertake(Job::Execute { queued: 0 }, &Call::at(Hook::Execute, now_ns), crew) {
            Err(second) => {
                self.step(Event::Fault);
                return climb.fail(second);
            }
            // It is at work, and waits for somebody else.
            Ok(Pause::Waits) => {
                self.keep_side_report();
                return Step::Works;
            }
            Ok(Pause::Done) => {}
        }
        climb.record.times.first_callback_ns = Some(since(fault));
        self.keep_side_report();
        self.slot.status.count_cycle(0);
        Step::Works
    }

    /// The slot stops. A sound instance is told why and kept, so that it can be destroyed in order.
    fn fault_stop(&mut self, cause: &Fault, crew: &mut Crew) -> Step {
        if self.unit.as_ref().is_some_and(|unit| !unit.spent) {
            let call = Call::plain(Hook::Error).telling(told(self.slot.name, cause));
            // What it does about it changes nothing any more.
            let _ = self.enter(call, crew);
        }
        self.end_tasks(TASK_END, crew);
        if let Some(unit) = self.unit.take_if(|unit| unit.spent) {
            unit.close();
            self.clear(unit, crew);
        }
        service::set_open(&self.slot, Openness::Gone);
        service::change_hands(&self.slot);
        self.shelf.retire();
        if let Some(spare) = self.put_spare_down() {
            self.clear(spare, crew);
        }
        Step::Stopped
    }

    /// A fault that only stops.
    pub(super) fn report_stop(&mut self, fault: &Fault, crew: &mut Crew) {
        Status::count(&self.slot.status.faults);
        let class = self.slot.status.class();
        let answer = match self.ladder.severity(fault.symptom) {
            Severity::Emergency => {
                emergency::raise(self.slot.name, fault.at_ns);
                Answer::Emergency
            }
            _ => self.raise_what_follows(Answer::Stop, fault),
        };
        self.tell_manager(fault, class, answer, Outcome::Stopped, Record::begin(fault), crew);
    }

    /// What a callback of the recovery raised is answered before the slot runs on; the next callback would erase it.
    pub(super) fn keep_side_report(&mut self) {
        if self.early.is_none()
            && let Some(fault) = callback::side_report()
        {
            self.early = Some(fault);
        }
    }

    /// What was raised on the way out, where nothing follows from it any more.
    pub(super) fn note_side_report(&mut self, crew: &mut Crew) {
        if let Some(fault) = callback::side_report() {
            self.note(&fault, crew);
        }
    }

    /// A fault that is only written down.
    pub(super) fn note(&mut self, fault: &Fault, crew: &mut Crew) {
        if fault.stage == Stage::Confirmed {
            Status::count(&self.slot.status.faults);
        }
        let class = self.slot.status.class();
        self.tell_manager(fault, class, Answer::Ignore, Outcome::Ignored, Record::default(), crew);
    }

    /// A fault that is left to that slot's, its root.
    pub(super) fn note_consequence(&mut self, fault: &Fault, cause: &'static str, crew: &Crew) {
        Status::count(&self.slot.status.faults);
        let (class, record) = (self.slot.status.class(), Record { cause: Some(cause), ..Record::begin(fault) });
        self.tell_manager(fault, class, Answer::Await, Outcome::Consequence, record, crew);
    }

    fn tell_manager(
        &self,
        fault: &Fault,
        class: &'static str,
        answer: Answer,
        outcome: Outcome,
        mut record: Record,
        crew: &Crew,
    ) {
        self.slot.status.count_taint(fault.memory);
        record.times.detected_ns = fault.detected_ns.saturating_sub(fault.at_ns);
        let event = FaultEvent {
            slot: self.slot.name,
            class,
            fault: *fault,
            severity: self.ladder.severity(fault.symptom),
            answer,
            successor: (outcome != Outcome::Stopped).then(|| self.slot.status.class()),
            outcome,
            checkpoint_ns: record.checkpoint_ns,
            cause: record.cause,
            times: record.times,
        };
        send(&crew.faults, event);
    }
}

/// Hands an event to the fault manager. A full queue loses the entry, not the recovery; the manager writes down how many
/// it did not get.
pub(super) fn send(faults: &FaultSender, event: FaultEvent) {
    if faults.try_send(event).is_err() {
        LOST.fetch_add(1, Ordering::Relaxed);
    }
}

fn since(fault: &Fault) -> u64 {
    clock::now_ns().saturating_sub(fault.at_ns)
}

/// As [`told`], where the text outlives the fault.
fn told_for_good(slot: &'static str, fault: &Fault) -> Option<FaultArgs<'static>> {
    let message = RStr::from_str(fault.evidence.lasting_text()?);
    Some(FaultArgs { symptom: RStr::from_str(fault.symptom.name()), slot: RStr::from_str(slot), message })
}

pub(super) fn told<'a>(slot: &'a str, fault: &'a Fault) -> FaultArgs<'a> {
    FaultArgs {
        symptom: RStr::from_str(fault.symptom.name()),
        slot: RStr::from_str(slot),
        message: RStr::from_str(fault.evidence.text()),
    }
}
