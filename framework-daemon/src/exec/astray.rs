//! Faults on threads that a component started: the slot is answered by its rules, as for a fault in a callback.

use super::callback;
use super::member::{Crew, Member};
use crate::model::fault::Fault;
use crate::model::lifecycle::State;
use crate::sys::foreign::Report;
use crate::sys::seat::Owner;

impl Member {
    /// Answers what happened on a thread of this slot. A thread that trapped takes its instance along, whose memory it
    /// shared; a panic leaves it sound. What a thread of an earlier instance does is only written down.
    pub fn blame(&mut self, report: &Report, crew: &mut Crew) {
        let Some(fault) = callback::astray(&report.event, report.at_ns) else { return };
        self.answer_for(report.owner.instance, &fault, crew);
    }

    /// Answers a fault that did not happen in a callback, by the slot's rules.
    pub(super) fn answer_for(&mut self, instance: u64, fault: &Fault, crew: &mut Crew) {
        let is_lost = fault.symptom.loses_instance();
        let unit =
            self.unit.as_mut().filter(|unit| unit.owner.instance == instance || instance == Owner::NONE.instance);
        let is_present = unit.is_some();
        unit.into_iter().for_each(|unit| unit.spent |= is_lost);
        match self.state() {
            State::Active if is_present => self.handle(fault, crew),
            _ if is_present && is_lost => self.lose(fault, crew),
            _ => self.blame_standby(instance, fault, crew),
        }
    }

    /// A standby or a spare is as lost as the instance in use; the next one is made when it is needed.
    fn blame_standby(&mut self, instance: u64, fault: &Fault, crew: &mut Crew) {
        if fault.symptom.loses_instance() {
            let mut units = self.standbys.iter_mut().map(|standby| &mut standby.unit);
            let standby = units.find_map(|unit| unit.take_if(|unit| unit.owner.instance == instance));
            if let Some(mut unit) = standby.or_else(|| self.find_spare(instance)) {
                unit.spent = true;
                crew.dispose(&self.slot, unit);
            }
        }
        self.note(fault, crew);
    }
}
