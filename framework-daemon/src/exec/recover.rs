//! The local answer to a fault, on the thread that saw it, from the table compiled at load: reset, replace or stop, at
//! once. The fault manager learns of it afterwards.
//!
//! The alternative, a manager thread that decides, costs a hand-over: 22 ms at p99.9 with all cores busy.

use std::sync::atomic::{AtomicU64, Ordering};

use abi_stable::std_types::RStr;
use component_sdk::abi::class::{FaultArgs, Hook};

use super::callback::{self, Call};
use super::member::{Crew, Member};
use super::slot::Status;
use super::unit::Unit;
use crate::model::fault::{Fault, FaultEvent, FaultSender, Outcome, ShortText, Times};
use crate::model::ladder::Answer;
use crate::model::lifecycle::Event;
use crate::model::limits::RECOVERY_STEPS_MAX;
use crate::profile::plan::Trigger;
use crate::sys::clock;

static LOST: AtomicU64 = AtomicU64::new(0);

/// Fault events that found the fault manager's queue full.
#[must_use]
pub fn lost_events() -> u64 {
    LOST.load(Ordering::Relaxed)
}

/// How one step of the ladder ended.
enum Step {
    /// The slot works.
    Works,
    /// The slot is stopped.
    Stopped,
    /// The recovery failed itself.
    Failed(Fault),
}

impl Member {
    /// Answers a fault of this slot.
    pub fn handle(&mut self, fault: Fault, crew: &mut Crew) {
        Status::count(&self.slot.status.faults);
        let class = self.slot.status.class();
        let answer = self.look_up(&fault);
        let mut times = Times { decided_ns: since(&fault), ..Times::default() };
        if answer == Answer::Ignore {
            self.tell_manager(fault, class, answer, Outcome::Ignored, times, crew);
            return;
        }
        self.step(Event::Fault);
        self.slot.outputs.iter().for_each(|port| port.forget_episodes());
        let (last, outcome) = self.climb(&fault, answer, &mut times, crew);
        self.tell_manager(fault, class, last, outcome, times, crew);
        crew.fibers.bury();
        self.prepare_fibers(crew);
        self.shelf.order();
    }

    /// An instance that cannot be entered again cannot be ignored either.
    fn look_up(&mut self, fault: &Fault) -> Answer {
        match self.ladder.answer(fault.symptom, fault.detected_ns) {
            Answer::Ignore if fault.symptom.loses_instance() => Answer::Stop,
            answer => answer,
        }
    }

    /// Walks the ladder until a step holds. A step that fails is followed by a further one, never by the same: nothing
    /// loops.
    fn climb(&mut self, fault: &Fault, first: Answer, times: &mut Times, crew: &mut Crew) -> (Answer, Outcome) {
        let (mut answer, mut cause) = (first, *fault);
        for _ in 0..RECOVERY_STEPS_MAX {
            let step = match answer {
                Answer::Reset => self.reset(&cause, fault, times, crew),
                Answer::Replace => self.replace(&cause, fault, times, crew),
                Answer::Stop | Answer::Ignore | Answer::Prepare => self.fault_stop(&cause, crew),
            };
            match step {
                Step::Works => return (answer, Outcome::Recovered),
                Step::Stopped => return (Answer::Stop, Outcome::Stopped),
                Step::Failed(second) => {
                    Status::count(&self.slot.status.faults);
                    let class = self.slot.status.class();
                    self.tell_manager(second, class, answer, Outcome::Failed, Times::default(), crew);
                    answer = self.ladder.further();
                    cause = second;
                }
            }
        }
        self.fault_stop(&cause, crew);
        (Answer::Stop, Outcome::Stopped)
    }

    /// The same instance where it is sound; a spare or, where none is ready, a fresh one of its class else.
    fn reset(&mut self, cause: &Fault, fault: &Fault, times: &mut Times, crew: &mut Crew) -> Step {
        if self.unit.as_ref().is_none_or(|unit| unit.spent) {
            let successor = self.shelf.take().map_or_else(|| self.make(self.shelf.in_use(), crew), Ok);
            return self.succeed(successor, cause, fault, times, crew);
        }
        let (text, hooks) = (cause.evidence.message(), [Hook::Error, Hook::Reset]);
        for hook in hooks {
            let args = told(self.slot.name, cause, &text);
            if let Err(second) = self.enter(Call { hook, inject: 0, fault: args }, crew) {
                return Step::Failed(second);
            }
            self.keep_side_report();
        }
        self.step(Event::Reset);
        if self.unit.as_ref().is_some_and(|unit| !unit.started)
            && let Err(second) = self.enter_start(crew)
        {
            self.step(Event::Fault);
            return Step::Failed(second);
        }
        self.keep_side_report();
        self.put_to_work(fault, times, crew)
    }

    /// The next secondary.
    fn replace(&mut self, cause: &Fault, fault: &Fault, times: &mut Times, crew: &mut Crew) -> Step {
        let Some(index) = self.ladder.secondary() else { return self.fault_stop(cause, crew) };
        let ready = self.standbys[index].unit.take();
        self.shelf.follow(index + 1);
        let unit = ready.map_or_else(|| self.make(index + 1, crew), Ok);
        self.succeed(unit, cause, fault, times, crew)
    }

    /// Puts a successor in the place of the instance in use.
    fn succeed(
        &mut self,
        successor: Result<Unit, Fault>,
        cause: &Fault,
        fault: &Fault,
        times: &mut Times,
        crew: &mut Crew,
    ) -> Step {
        let unit = match successor {
            Ok(unit) => unit,
            Err(second) => return Step::Failed(second),
        };
        self.slot.status.set_class(unit.recipe);
        self.unit.iter().for_each(Unit::close);
        unit.open();
        let old = self.unit.replace(unit);
        let step = self.take_over(cause, fault, times, crew);
        // The old one's end is nobody's hurry.
        if let Some(old) = old {
            self.clear(old, crew);
        }
        step
    }

    /// Leaves a unit to the workshop.
    fn clear(&self, unit: Unit, crew: &mut Crew) {
        if unit.spent {
            Status::count(&self.slot.status.quarantined);
        }
        if let Err(unit) = self.shelf.clear(unit) {
            crew.end(&self.slot, *unit);
        }
    }

    fn take_over(&mut self, cause: &Fault, fault: &Fault, times: &mut Times, crew: &mut Crew) -> Step {
        let text = cause.evidence.message();
        let args = told(self.slot.name, cause, &text);
        if let Err(second) = self.enter(Call { hook: Hook::Recover, inject: 0, fault: args }, crew) {
            return Step::Failed(second);
        }
        self.keep_side_report();
        self.step(Event::Recover);
        self.step(Event::Start);
        if let Err(second) = self.enter_start(crew) {
            self.step(Event::Fault);
            return Step::Failed(second);
        }
        self.keep_side_report();
        self.put_to_work(fault, times, crew)
    }

    /// The callback that the fault cut short, again.
    fn put_to_work(&mut self, fault: &Fault, times: &mut Times, crew: &mut Crew) -> Step {
        times.ready_ns = Some(since(fault));
        if self.trigger == Trigger::Passive {
            return Step::Works;
        }
        match self.enter(Call::plain(Hook::Execute), crew) {
            Ok(()) => {
                times.first_callback_ns = Some(since(fault));
                self.keep_side_report();
                Status::count(&self.slot.status.cycles);
                Step::Works
            }
            Err(second) => {
                self.step(Event::Fault);
                Step::Failed(second)
            }
        }
    }

    /// The slot stops. A sound instance is told why and kept, so that it can be destroyed in order.
    fn fault_stop(&mut self, cause: &Fault, crew: &mut Crew) -> Step {
        if self.unit.as_ref().is_some_and(|unit| !unit.spent) {
            let text = cause.evidence.message();
            let call = Call { hook: Hook::Error, inject: 0, fault: told(self.slot.name, cause, &text) };
            // What it does about it changes nothing any more.
            let _ = self.enter(call, crew);
        }
        if let Some(unit) = self.unit.take_if(|unit| unit.spent) {
            self.clear(unit, crew);
        }
        Step::Stopped
    }

    /// A fault that only stops.
    pub(super) fn report_stop(&mut self, fault: Fault, crew: &mut Crew) {
        Status::count(&self.slot.status.faults);
        let times = Times { decided_ns: since(&fault), ..Times::default() };
        let class = self.slot.status.class();
        self.tell_manager(fault, class, Answer::Stop, Outcome::Stopped, times, crew);
    }

    /// What a callback of the recovery raised is answered before the slot runs on; the next callback would erase it.
    fn keep_side_report(&mut self) {
        self.early = self.early.take().or_else(|| callback::side_report().map(Box::new));
    }

    /// What was raised on the way out, where nothing follows from it any more.
    pub(super) fn note_side_report(&mut self, crew: &mut Crew) {
        if let Some(fault) = callback::side_report() {
            self.note(fault, crew);
        }
    }

    /// A fault that is only written down.
    pub(super) fn note(&mut self, fault: Fault, crew: &mut Crew) {
        Status::count(&self.slot.status.faults);
        let class = self.slot.status.class();
        self.tell_manager(fault, class, Answer::Ignore, Outcome::Ignored, Times::default(), crew);
    }

    fn tell_manager(
        &self,
        fault: Fault,
        class: &'static str,
        answer: Answer,
        outcome: Outcome,
        mut times: Times,
        crew: &Crew,
    ) {
        times.detected_ns = fault.detected_ns.saturating_sub(fault.at_ns);
        let event = FaultEvent {
            slot: self.slot.name,
            class,
            fault,
            severity: self.ladder.severity(fault.symptom),
            answer,
            successor: (outcome != Outcome::Stopped).then(|| self.slot.status.class()),
            outcome,
            times,
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

fn told<'a>(slot: &'a str, fault: &Fault, text: &'a ShortText) -> FaultArgs<'a> {
    FaultArgs {
        symptom: RStr::from_str(fault.symptom.name()),
        slot: RStr::from_str(slot),
        message: RStr::from_str(text.as_str()),
    }
}
