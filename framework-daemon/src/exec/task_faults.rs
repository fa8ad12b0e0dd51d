//! Tasks and their member: what a task did wrong is answered by the slot's rules, as a fault in a callback is.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::member::{Crew, Member};
use super::task::{Post, Verdict};
use super::unit::Unit;
use crate::model::fault::{Evidence, Fault};
use crate::model::lifecycle::State;
use crate::model::symptom::{Severity, Symptom};
use crate::model::text::ShortText;
use crate::plugin::task;
use crate::sys::{clock, crowd, log_ring};

impl Member {
    /// Answers what tasks have told.
    pub fn hear_tasks(&mut self, crew: &mut Crew) {
        while let Some(Post { task, fault, asks }) = self.slot.tasks.posts.pop() {
            self.answer_for(task.instance, &fault, crew);
            if asks {
                let goes_on = self.state() == State::Active
                    && self.unit.as_ref().is_some_and(|unit| unit.owner.instance == task.instance && !unit.spent)
                    // What ran once and failed is not run again where nobody minds.
                    && (task.period_ns.is_some() || self.ladder.severity(fault.symptom) != Severity::Ignore);
                task.set_verdict(if goes_on { Verdict::Again } else { Verdict::Over });
                self.slot.tasks.signal.tasks().wake(task.place);
            }
        }
    }

    /// Ends the tasks of the instance in use. Those of one that is sound have some time for it; where it is not enough, they
    /// are ended by force, and the instance is sound no more.
    pub(super) fn end_tasks(&mut self, grace: Duration, crew: &mut Crew) {
        if self.slot.tasks.is_empty() {
            return;
        }
        let grace = self.unit.as_ref().filter(|unit| !unit.spent).map(|_| grace);
        let names: Vec<_> = self.slot.tasks.all().iter().map(|task| task.name).collect();
        if !self.slot.tasks.end(grace)
            && let Some(unit) = self.unit.as_mut().filter(|unit| !unit.spent)
        {
            unit.spent = true;
            let name = names.first().map_or("", |name| name.as_str());
            let message = ShortText::of(format_args!("task {name} was cancelled and did not come to its end"));
            self.note(&Fault::told(Symptom::Hang, clock::now_ns(), Evidence::Text { message }), crew);
        }
        // What they still had to tell has no consequences any more, but for the instance.
        while let Some(Post { task, fault, .. }) = self.slot.tasks.posts.pop() {
            let unit = self.unit.as_mut().filter(|unit| unit.owner.instance == task.instance);
            unit.into_iter().for_each(|unit| unit.spent |= fault.symptom.loses_instance());
            self.note(&fault, crew);
        }
    }
}

/// Starts what a callback of `unit` wants started. An instance that is not in use runs no tasks: its ports lead nowhere.
pub(super) fn start_tasks(unit: &Unit) {
    while let Some(spawned) = task::take_spawned() {
        unit.gave_to_tasks.store(true, Ordering::Relaxed);
        if unit.spent {
            // What it holds may be half-changed: it stays.
            crowd::release(unit.owner.instance);
            continue;
        }
        let runs = unit.is_in_use();
        if !runs {
            let text = "a task that is started before `start` does not run: the instance is not in use yet";
            log_ring::put(1, unit.owner.slot, text);
        }
        if let Err(error) = unit.tasks.start(&spawned, unit.owner.instance, unit.limits, runs) {
            let text = ShortText::of(format_args!("task {} cannot be started: {error}", spawned.name.as_str()));
            log_ring::put(1, unit.owner.slot, text.as_str());
        }
    }
}
