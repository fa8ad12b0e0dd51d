//! Requests, messages, values and events of other slots: each is served by a handler, in turn with the slot's other callbacks.

use component_sdk::abi::calls::ServeArgs;
use component_sdk::status::Status;

use super::member::{Crew, Member};
use super::slot::Slot;
use super::strand::Job;
use crate::port::event_in::Due;
use crate::port::pattern::provider::Openness;
use crate::port::pattern::subscriber::Subscriber;
use crate::port::pattern::turns;

impl Member {
    /// Enters the handler of a request or an event, if one waits.
    pub fn serve(&mut self, crew: &mut Crew) {
        if !self.is_clear(crew) {
            return;
        }
        let Some(Due { hook, serve }) = self.slot.events.next_or(|| self.next_serve()) else { return };
        let call = self.call(hook, crew).serving(serve);
        let result = self.undertake(Job::Serve, &call, crew);
        self.after(&result, call.now_ns, crew);
    }

    /// What is to be handled next: cycles first, which are late otherwise, then requests, then values that arrived.
    fn next_serve(&self) -> Option<ServeArgs> {
        let slot = &self.slot;
        let request = || turns::next(&slot.providers);
        if !slot.handles_pushes {
            return request();
        }
        let tick = slot.outputs.iter().find_map(|port| port.outlet().next());
        let value = || slot.inputs.iter().filter_map(|port| port.subscriber()).find_map(Subscriber::next);
        tick.or_else(request).or_else(value)
    }

    /// True when something waits that a handler is to be entered for.
    pub(super) fn has_to_serve(&self) -> bool {
        let slot = &self.slot;
        slot.providers.iter().any(|port| port.waits()) || (slot.handles_pushes && self.has_pushed())
    }

    fn has_pushed(&self) -> bool {
        let slot = &self.slot;
        slot.inputs.iter().filter_map(|port| port.subscriber()).any(Subscriber::waits)
            || slot.outputs.iter().any(|port| port.outlet().has_ticked())
    }

    /// When the next cycle of one of its timed servers begins.
    pub(super) fn next_tick_ns(&self) -> Option<u64> {
        self.slot.outputs.iter().filter_map(|port| port.outlet().due_ns()).min()
    }

    /// Begins the cycles that are due.
    pub(super) fn tick(&self, now_ns: u64) {
        self.slot.outputs.iter().for_each(|port| port.outlet().turn(now_ns));
    }

    /// True where a port of it has a cycle.
    pub(super) fn is_timed(&self) -> bool {
        self.slot.outputs.iter().any(|port| port.outlet().cycle().period_ns.is_some())
    }
}

/// The slot's servers answer from now on, or do not.
pub(super) fn set_open(slot: &Slot, open: Openness) {
    slot.providers.iter().for_each(|port| port.set_open(open));
    slot.events.set_open(open);
    slot.outputs.iter().for_each(|port| port.set_open(open));
    if open == Openness::Stopped {
        slot.inputs.iter().for_each(|port| port.unsubscribe());
    }
}

/// The slot's callbacks may wait from now on, or may not.
pub(super) fn set_blocking(slot: &Slot, blocking: bool) {
    slot.requestors.iter().for_each(|port| port.set_blocking(blocking));
    slot.providers.iter().for_each(|port| port.set_blocking(blocking));
    slot.events.set_blocking(blocking);
    slot.inputs.iter().filter_map(|port| port.subscriber()).for_each(|port| port.set_blocking(blocking));
}

/// The slot's instance is another one from now on: what the last one asked nobody waits for, and what it had in hand is
/// over, or asked again.
pub(super) fn change_hands(slot: &Slot) {
    slot.requestors.iter().for_each(|port| port.close_calls());
    slot.providers.iter().for_each(|port| port.fail());
    slot.events.change_hands();
    slot.inputs.iter().filter_map(|port| port.subscriber()).for_each(Subscriber::change_hands);
    slot.outputs.iter().for_each(|port| port.tell(Status::ProviderGone));
}
