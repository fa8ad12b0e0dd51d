//! What is done to a slot from outside, on its executor: back to work after a fault-stop, the emergency stop.

use component_sdk::abi::class::Hook;

use super::callback::Call;
use super::emergency::{self, Notice};
use super::executor::Move;
use super::member::{Crew, Member};
use super::service;
use crate::model::fault::{Evidence, Fault, ShortText};
use crate::model::lifecycle::{Event, State};
use crate::model::symptom::Symptom;
use crate::port::pattern::provider::Openness;
use crate::sys::{clock, latch, safe_outputs};

impl Member {
    /// Does what was asked; returns the state it is in then.
    pub fn steer(&mut self, act: Move, crew: &mut Crew) -> State {
        match act {
            Move::Stop => self.stop(crew),
            Move::Raise if self.state() == State::Error => self.raise(crew),
            Move::Start | Move::Raise => self.start_again(crew),
        }
        self.state()
    }

    /// `start` of a slot that was stopped: of the same instance, unless it gave something to tasks, or was spent by its stop.
    /// Tasks have come to their end with what was moved into them; a second `start` would find closed ports.
    fn start_again(&mut self, crew: &mut Crew) {
        let is_whole = self.unit.as_ref().is_some_and(|unit| unit.is_whole());
        if is_whole || self.state() != State::Inactive {
            return self.start(crew);
        }
        match self.renew("started again by an operator, or with what it needs", crew) {
            Ok(()) => self.start(crew),
            Err(fault) => self.lose(&fault, crew),
        }
    }

    /// Back to work after a fault-stop, with a clean record: the same instance where it is whole, a fresh one of the class in
    /// use else. A fault on the way stops it again.
    fn raise(&mut self, crew: &mut Crew) {
        // It is on its way already.
        if self.breath.is_some() {
            return;
        }
        self.ladder.forgive();
        service::set_blocking(&self.slot, true);
        let is_whole = self.unit.as_ref().is_some_and(|unit| unit.is_whole());
        let raised = if is_whole { self.reset_sound(crew) } else { self.fill_anew(crew) };
        match raised {
            Ok(()) => {
                self.keep_side_report();
                self.shelf.reopen();
                self.begin();
            }
            Err(fault) => {
                self.lose(&fault, crew);
                service::set_open(&self.slot, Openness::Gone);
                service::change_hands(&self.slot);
            }
        }
        self.prepare_fibers(crew);
        self.shelf.order();
    }

    fn reset_sound(&mut self, crew: &mut Crew) -> Result<(), Fault> {
        self.enter(Call::plain(Hook::Reset), crew)?;
        self.step(Event::Reset);
        if self.unit.as_ref().is_some_and(|unit| !unit.started) {
            self.enter_start(crew)?;
        }
        Ok(())
    }

    fn fill_anew(&mut self, crew: &mut Crew) -> Result<(), Fault> {
        self.renew("reset by an operator", crew)?;
        self.step(Event::Recover);
        self.step(Event::Start);
        self.enter_start(crew)
    }

    /// A fresh instance of the class in use, which is told why it is there.
    fn renew(&mut self, why: &str, crew: &mut Crew) -> Result<(), Fault> {
        let unit = self.make(self.shelf.in_use(), crew)?;
        self.slot.status.set_class(unit.recipe);
        if let Some(mut old) = self.unit.take() {
            old.close();
            // It was stopped with its slot.
            old.started = false;
            self.clear(old, crew);
        }
        unit.open();
        self.unit = Some(unit);
        self.restore(crew)?;
        let evidence = Evidence::Text { message: ShortText::new(why) };
        let cause = Fault::told(Symptom::Raised, clock::now_ns(), evidence);
        let call = Call::plain(Hook::Recover).telling(super::recover::told(self.slot.name, &cause));
        self.enter(call, crew)
    }

    /// The emergency stop: `on_emergency`, the slot's safe outputs once more, because its component may have written since
    /// they were, then a stop, and the outputs again: unless the component took them back when it stopped, they are the last
    /// word.
    pub fn emergency_stop(&mut self, crew: &mut Crew) {
        let state = self.state();
        // Taken back before it was heard; or heard before.
        let Some(since_us) = latch::mark().map(latch::Mark::since_us) else { return };
        if std::mem::replace(&mut self.stopped_us, since_us) == since_us && state != State::Active {
            return;
        }
        self.end_wait(crew);
        let is_sound = self.unit.as_ref().is_some_and(|unit| !unit.spent);
        if is_sound && matches!(state, State::Active | State::Error) {
            match self.enter(Call::plain(Hook::Emergency), crew) {
                Ok(()) => self.note_side_report(crew),
                Err(fault) => self.lose(&fault, crew),
            }
        }
        let before = safe_outputs::write_of(self.slot.name);
        // Whoever raised it may have lost the processor to this thread when it was told.
        latch::store();
        self.stop(crew);
        let outputs = safe_outputs::write_of(self.slot.name).max(before);
        let (slot, state, at_ns) = (self.slot.name, self.state(), clock::now_ns());
        emergency::tell(Notice::Stopped { slot, state, outputs, at_ns });
    }
}
