//! What others charge a slot with, taken up by its executor between callbacks and answered by the slot's rules, as a fault of
//! its own is.

use super::member::{Crew, Member};
use super::slot::Slot;
use crate::model::fault::Fault;
use crate::model::lifecycle::State;
use crate::port::charge::Accused;

impl Slot {
    /// Charges the slot with a fault that somebody else saw, from any thread: no lock, no allocation. False: too many wait
    /// already, and this one is counted as lost.
    pub fn charge(&self, fault: &Fault) -> bool {
        self.charges.charge(fault)
    }
}

impl Member {
    /// Answers what others charge the slot with. One that does not work has nothing to answer for: it is only written down.
    pub(super) fn hear_charges(&mut self, crew: &mut Crew) {
        while let Some(fault) = self.slot.charges.next() {
            if Self::is_of_device(&fault) {
                self.hear_of_device(&fault, crew);
                continue;
            }
            match self.state() {
                State::Active => self.handle(&fault, crew),
                _ => {
                    self.slot.charges.leave();
                    self.note(&fault, crew);
                }
            }
        }
    }
}
