//! Requests, messages and events of other slots: each is served by a handler, in turn with the slot's other callbacks.

use super::callback::Call;
use super::member::{Crew, Member};
use super::slot::Slot;
use super::strand::Job;
use crate::port::event_in::Due;
use crate::port::pattern::provider::Openness;

impl Member {
    /// Enters the handler of a request or an event, if one waits.
    pub fn serve(&mut self, crew: &mut Crew) {
        if !self.is_clear(crew) {
            return;
        }
        let asked = || self.slot.providers.iter().find_map(|port| port.next());
        let Some(Due { hook, serve }) = self.slot.events.next_or(asked) else { return };
        let call = Call { serve, ..self.call(hook, crew) };
        let result = self.undertake(Job::Serve, &call, crew);
        self.after(&result, call.now_ns, crew);
    }
}

/// The slot's servers answer from now on, or do not.
pub(super) fn set_open(slot: &Slot, open: Openness) {
    slot.providers.iter().for_each(|port| port.set_open(open));
    slot.events.set_open(open);
}

/// The slot's callbacks may wait from now on, or may not.
pub(super) fn set_blocking(slot: &Slot, blocking: bool) {
    slot.requestors.iter().for_each(|port| port.set_blocking(blocking));
    slot.providers.iter().for_each(|port| port.set_blocking(blocking));
    slot.events.set_blocking(blocking);
}

/// The slot's instance is another one from now on: what the last one asked nobody waits for, and what it had in hand is
/// over, or asked again.
pub(super) fn change_hands(slot: &Slot) {
    slot.requestors.iter().for_each(|port| port.close_calls());
    slot.providers.iter().for_each(|port| port.fail());
    slot.events.change_hands();
}
