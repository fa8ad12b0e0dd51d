//! All event ports of a slot, as its executor deals with them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use component_sdk::abi::calls::ServeArgs;
use component_sdk::abi::class::Hook;

use super::border::PortEnd;
use super::event_in::{Due, EventIn};
use super::input::InPort;
use super::output::OutPort;
use super::pattern::event_client::EventClient;
use super::pattern::event_server::EventServer;
use super::pattern::provider::Openness;
use crate::sys::bell::{Ring, Signal};

/// The event ports of a slot.
#[derive(Default)]
pub struct EventEnds {
    /// Clients.
    pub clients: Vec<Arc<EventClient>>,
    /// Servers.
    pub servers: Vec<Arc<EventServer>>,
    /// Inputs of OPRoS.
    pub inputs: Vec<Arc<EventIn>>,
    /// Outputs of OPRoS.
    pub outputs: Vec<Arc<OutPort>>,
    /// Events had the last turn.
    turn: AtomicBool,
    signal: OnceLock<Arc<Signal>>,
}

fn served(serve: ServeArgs) -> Due {
    Due { hook: Hook::Serve, serve }
}

impl EventEnds {
    /// Says who is rung when something comes in; once.
    pub fn listen(&self, signal: &Arc<Signal>) {
        let _ = self.signal.set(Arc::clone(signal));
        self.clients.iter().for_each(|port| port.listen(Arc::clone(signal)));
        self.servers.iter().for_each(|port| port.listen(Arc::clone(signal)));
        self.inputs.iter().for_each(|port| port.listen(Arc::clone(signal)));
    }

    /// The event callback that is due, or else what `other` has; each goes first in turn. Of activations a component is told
    /// before anything else: what comes after them may put.
    pub fn next_or(&self, other: impl Fn() -> Option<ServeArgs>) -> Option<Due> {
        let other = || other().map(served);
        if self.is_empty() {
            return other();
        }
        // What a callback had that did not come to its end.
        self.served();
        if let Some(told) = self.servers.iter().find_map(|port| port.next_told()) {
            return Some(served(told));
        }
        let was_first = self.turn.fetch_xor(true, Ordering::Relaxed);
        if was_first { other().or_else(|| self.next()) } else { self.next().or_else(other) }
    }

    /// True without any.
    #[must_use]
    #[inline]
    pub const fn is_empty(&self) -> bool {
        self.clients.is_empty() && self.servers.is_empty() && self.inputs.is_empty()
    }

    fn next(&self) -> Option<Due> {
        let fired = self.clients.iter().find_map(|port| port.next()).map(served);
        fired.or_else(|| self.inputs.iter().find_map(|port| port.next()))
    }

    /// A callback is done; true when another one is due.
    #[must_use]
    pub fn settle(&self) -> bool {
        if self.is_empty() {
            return false;
        }
        self.served();
        self.waits()
    }

    fn waits(&self) -> bool {
        self.servers.iter().any(|port| port.waits())
            || self.clients.iter().any(|port| port.waits())
            || self.inputs.iter().any(|port| port.waits())
    }

    fn served(&self) {
        self.servers.iter().for_each(|port| port.served());
        self.clients.iter().for_each(|port| port.served());
        self.inputs.iter().for_each(|port| port.served());
    }

    /// The slot's servers put from now on, or do not; what came in before it did is looked at.
    pub fn set_open(&self, open: Openness) {
        self.servers.iter().for_each(|port| port.set_open(open));
        let has_events = self.inputs.iter().any(|port| port.port.has_data());
        if open == Openness::Serving
            && (has_events || self.waits())
            && let Some(signal) = self.signal.get()
        {
            signal.ring(Ring::Serve);
        }
    }

    /// The slot's callbacks may wait from now on, or may not.
    pub fn set_blocking(&self, on: bool) {
        self.clients.iter().for_each(|port| port.set_blocking(on));
    }

    /// The slot's instance is another one from now on.
    pub fn change_hands(&self) {
        self.clients.iter().for_each(|port| port.forget());
        self.servers.iter().for_each(|port| port.fail());
        self.served();
    }

    /// The slot is about to be removed or built anew: nobody is to wait for it.
    pub fn replace(&self) {
        self.servers.iter().for_each(|port| port.replace());
    }

    /// The port of that name: what receives, or what sends.
    #[must_use]
    pub fn end(&self, name: &str, input: bool) -> Option<PortEnd> {
        self.ends().find(|end| end.name() == name && end.receives() == input)
    }

    /// The queue of the input of that name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&Arc<InPort>> {
        self.inputs.iter().map(|event| &event.port).find(|port| port.name == name)
    }

    /// The output of that name.
    #[must_use]
    pub fn output(&self, name: &str) -> Option<&Arc<OutPort>> {
        self.outputs.iter().find(|port| port.name == name)
    }

    /// The names of all of them.
    pub fn names(&self) -> impl Iterator<Item = &str> + '_ {
        let clients = self.clients.iter().map(|port| &port.name);
        let servers = self.servers.iter().map(|port| &port.name);
        let inputs = self.inputs.iter().map(|event| &event.port.name);
        let outputs = self.outputs.iter().map(|port| &port.name);
        clients.chain(servers).chain(inputs).chain(outputs).map(String::as_str)
    }

    /// All of them: inputs, outputs, clients, servers.
    pub fn ends(&self) -> impl Iterator<Item = PortEnd> + '_ {
        let clients = self.clients.iter().cloned().map(PortEnd::EventClient);
        let servers = self.servers.iter().cloned().map(PortEnd::EventServer);
        let inputs = self.inputs.iter().cloned().map(PortEnd::EventIn);
        let outputs = self.outputs.iter().cloned().map(PortEnd::EventOut);
        inputs.chain(outputs).chain(clients).chain(servers)
    }
}
