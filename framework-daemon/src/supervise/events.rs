//! Event ports: made after a class and its profile, connected after a plan.

use std::collections::HashMap;
use std::sync::Arc;

use component_sdk::abi::class::{Direction, Pattern, PortDecl};
use component_sdk::object::TypeDescriptor;

use super::blueprint::Blueprint;
use super::system::Placed;
use super::wiring::{at, complain, no_such_port};
use crate::exec::slot::Slot;
use crate::fault::ports;
use crate::model::limits::{ACTIVATIONS_DEFAULT, FIFO_SIZE_DEFAULT, WAIT};
use crate::model::time::nanoseconds;
use crate::port::check::Checks;
use crate::port::event_ends::EventEnds;
use crate::port::event_in::EventIn;
use crate::port::input::InPort;
use crate::port::output::OutPort;
use crate::port::pattern::event_client::{self, EventClient, Room};
use crate::port::pattern::event_server::EventServer;
use crate::port::wait::Waiter;
use crate::port::wiring::{self, Planned};
use crate::profile::plan::{ComponentPlan, ConnectionPlan, EventPortPlan, Overflow, PortKind, PortRef, Queue};

/// Adds the port of that declaration.
///
/// # Errors
/// In words.
pub(super) fn add(
    ports: &mut EventEnds,
    decl: &PortDecl,
    component: &ComponentPlan,
    waiter: &Arc<Waiter>,
) -> Result<(), String> {
    let (name, object) = (decl.name.as_str(), decl.object);
    let declared = component.event_ports.iter().find(|port| port.name == name);
    if decl.pattern == Pattern::EventPort {
        match decl.direction {
            Direction::Input => ports.inputs.push(Arc::new(input(decl, declared))),
            Direction::Output => ports.outputs.push(Arc::new(OutPort::new(name, object, Checks::default()))),
        }
        return Ok(());
    }
    let parameter = decl.answer.into_option();
    let parameter = parameter.ok_or_else(|| format!("port `{name}`: events without a parameter"))?;
    let waiter = Arc::clone(waiter);
    match decl.direction {
        Direction::Input => {
            ports.clients.push(Arc::new(EventClient::new(name, parameter, object, room(decl, declared), waiter)));
        }
        Direction::Output => {
            ports.servers.push(Arc::new(EventServer::new(name, parameter, object, decl.handler, waiter)));
        }
    }
    Ok(())
}

/// The profile's queue holds; where it says nothing of the port, the author's, and where nobody says anything, OPRoS's.
fn queue(decl: &PortDecl, declared: Option<&EventPortPlan>) -> (usize, Overflow) {
    let author = if decl.fifo > 0 { decl.fifo } else { FIFO_SIZE_DEFAULT };
    declared.map_or((author, Overflow::DropOldest), |port| (port.queue_size.unwrap_or(author), port.overflow))
}

fn input(decl: &PortDecl, declared: Option<&EventPortPlan>) -> EventIn {
    let (size, overflow) = queue(decl, declared);
    let port = InPort::new(decl.name.as_str(), decl.object, Queue::Fifo { size, overflow }, Checks::default());
    EventIn::new(port, decl.handler)
}

fn room(decl: &PortDecl, declared: Option<&EventPortPlan>) -> Room {
    let (queue, overflow) = queue(decl, declared);
    Room {
        activations: declared.map_or(ACTIVATIONS_DEFAULT, |port| port.activations),
        queue,
        overflow,
        handled: decl.handler,
        timeout_ns: nanoseconds(declared.map_or(WAIT, |port| port.timeout)),
    }
}

/// What a plan says about an event input that it, or the one before it, speaks of.
struct Reader {
    slot: &'static str,
    input: Arc<EventIn>,
    writers: Vec<Planned>,
}

/// What it says about a client of events.
struct Asker {
    client: Arc<EventClient>,
    server: Option<Arc<EventServer>>,
}

/// All connections of event ports. Ports that nobody speaks of, somebody connected at run time, and they stay so.
#[derive(Default)]
pub struct EventWiring {
    readers: Vec<Reader>,
    askers: Vec<Asker>,
}

/// The two ends of a connection, found.
enum Ends {
    Stream(Arc<OutPort>, Arc<EventIn>),
    Asked(Arc<EventServer>, Arc<EventClient>),
}

/// Builds all connections of event ports.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(
    before: &[ConnectionPlan],
    connections: &[ConnectionPlan],
    slots: &[Placed],
) -> Result<EventWiring, Vec<String>> {
    let names = by_name(slots);
    let (mut wiring, mut errors) = (EventWiring::default(), Vec::new());
    for connection in events(before).chain(events(connections)) {
        wiring.speak_of(&connection.target, &names);
    }
    for connection in events(connections) {
        if let Err(reason) = ends(connection, &names).and_then(|ends| wiring.plan(connection, ends)) {
            errors.push(at(&connection.location, &reason));
        }
    }
    if errors.is_empty() { Ok(wiring) } else { Err(errors) }
}

/// Slots by name, and among them what the fault manager's ports belong to.
fn by_name(slots: &[Placed]) -> HashMap<&str, &Slot> {
    let manager: &Slot = ports::shared().slot();
    slots.iter().map(|placed| &*placed.slot).chain([manager]).map(|slot| (slot.name, slot)).collect()
}

fn events(connections: &[ConnectionPlan]) -> impl Iterator<Item = &ConnectionPlan> {
    connections.iter().filter(|connection| connection.kind == PortKind::Event)
}

fn ends(connection: &ConnectionPlan, slots: &HashMap<&str, &Slot>) -> Result<Ends, String> {
    let (from, to) = (&connection.source, &connection.target);
    let missing = || no_such_port(connection);
    let source = &slots.get(from.slot.as_str()).ok_or_else(missing)?.events;
    let target = &slots.get(to.slot.as_str()).ok_or_else(missing)?.events;
    find(connection, source, target)
}

/// The ends among the event ports of two slots, held against each other.
fn find(connection: &ConnectionPlan, source: &EventEnds, target: &EventEnds) -> Result<Ends, String> {
    let (from, to) = (&connection.source, &connection.target);
    let output = source.outputs.iter().find(|port| port.name == from.port);
    let server = source.servers.iter().find(|port| port.name == from.port);
    let input = target.inputs.iter().find(|port| port.port.name == to.port);
    let client = target.clients.iter().find(|port| port.name == to.port);
    match (output, server, input, client) {
        (Some(output), _, Some(input), _) => {
            compare(connection, output.object, input.port.object)?;
            Ok(Ends::Stream(Arc::clone(output), Arc::clone(input)))
        }
        (_, Some(server), _, Some(client)) => {
            let difference =
                event_client::difference((client.parameter, client.event), (server.parameter, server.event));
            match difference {
                None => Ok(Ends::Asked(Arc::clone(server), Arc::clone(client))),
                Some(difference) => Err(format!(
                    "{}.{} tells of {} for {}, {}.{} asks for {} with {}: {difference}; build both plugins against the \
                     same definition",
                    from.slot,
                    from.port,
                    server.event.name,
                    server.parameter.name,
                    to.slot,
                    to.port,
                    client.event.name,
                    client.parameter.name
                )),
            }
        }
        (Some(_), _, _, Some(_)) => Err(mixed(connection, "an event output", "a client of events")),
        (_, Some(_), Some(_), _) => Err(mixed(connection, "a server of events", "an event input")),
        _ => Err(no_such_port(connection)),
    }
}

fn mixed(connection: &ConnectionPlan, source: &str, target: &str) -> String {
    let (from, to) = (&connection.source, &connection.target);
    format!(
        "{}.{} is {source}, {}.{} is {target}: an EventOut goes with an EventIn, an EventServer with an EventClient",
        from.slot, from.port, to.slot, to.port
    )
}

fn compare(
    connection: &ConnectionPlan,
    sent: &'static TypeDescriptor,
    expected: &'static TypeDescriptor,
) -> Result<(), String> {
    let (from, to) = (&connection.source, &connection.target);
    sent.difference(expected).map_or(Ok(()), |difference| {
        Err(format!(
            "{}.{} sends {}, {}.{} expects {}, and their layouts differ: {difference}; build both plugins against the same \
             definition",
            from.slot, from.port, sent.name, to.slot, to.port, expected.name
        ))
    })
}

/// What is wrong with a connection of slots that do not exist yet.
///
/// # Errors
/// That.
pub(super) fn check(connection: &ConnectionPlan, source: &Blueprint<'_>, target: &Blueprint<'_>) -> Result<(), String> {
    find(connection, &source.events, &target.events).map(drop)
}

/// What is wrong with connections of clients that have another server already.
pub(super) fn check_clients(connections: &[ConnectionPlan], blueprints: &[Blueprint<'_>]) -> Vec<String> {
    let is_client = |PortRef { slot, port }: &PortRef| {
        let slot = blueprints.iter().find(|blueprint| blueprint.name() == slot);
        slot.is_some_and(|slot| slot.events.clients.iter().any(|client| client.name == *port))
    };
    let mut seen = Vec::new();
    let mut twice = Vec::new();
    for connection in events(connections).filter(|connection| is_client(&connection.target)) {
        if seen.contains(&&connection.target) {
            twice.push(at(&connection.location, &second_server(&connection.target)));
        }
        seen.push(&connection.target);
    }
    twice
}

fn second_server(client: &PortRef) -> String {
    format!("{}.{} is already connected to a server: a client of events has exactly one", client.slot, client.port)
}

impl EventWiring {
    /// Somebody speaks of that port.
    fn speak_of(&mut self, PortRef { slot, port }: &PortRef, slots: &HashMap<&str, &Slot>) {
        let Some(slot) = slots.get(slot.as_str()) else { return };
        let ports = &slot.events;
        if let Some(input) = ports.inputs.iter().find(|input| input.port.name == *port)
            && self.readers.iter().all(|known| !Arc::ptr_eq(&known.input, input))
        {
            self.readers.push(Reader { slot: slot.name, input: Arc::clone(input), writers: Vec::new() });
        }
        if let Some(client) = ports.clients.iter().find(|client| client.name == *port)
            && self.askers.iter().all(|known| !Arc::ptr_eq(&known.client, client))
        {
            self.askers.push(Asker { client: Arc::clone(client), server: None });
        }
    }

    fn plan(&mut self, connection: &ConnectionPlan, ends: Ends) -> Result<(), String> {
        match ends {
            Ends::Stream(output, input) => {
                let reader = self.readers.iter_mut().find(|known| Arc::ptr_eq(&known.input, &input));
                reader.into_iter().for_each(|reader| {
                    reader.writers.push(Planned { output: Arc::clone(&output), checks: Checks::none() });
                });
            }
            Ends::Asked(server, client) => {
                let asker = self.askers.iter_mut().find(|known| Arc::ptr_eq(&known.client, &client));
                if let Some(asker) = asker
                    && asker.server.replace(server).is_some()
                {
                    return Err(second_server(&connection.target));
                }
            }
        }
        Ok(())
    }
}

/// Puts the connections in place. One that was there before goes on, with its activations.
pub fn apply(wiring: &EventWiring) {
    for Reader { slot, input, writers } in &wiring.readers {
        if wiring::set(&input.port, writers).is_err() {
            complain(slot, &input.port.name);
        }
    }
    for Asker { client, server } in &wiring.askers {
        match server {
            Some(server) => {
                if let Err(reason) = client.connect(server) {
                    tracing::error!("port {}: {reason}", client.name);
                }
            }
            None => client.disconnect(),
        }
    }
}

/// Takes all connections off slots that leave.
pub fn disconnect(slots: &[Placed]) {
    for Placed { slot, .. } in slots {
        let ports = &slot.events;
        let outputs = ports.outputs.iter().map(|port| (&port.name, wiring::detach_all(port)));
        let inputs = ports.inputs.iter().map(|port| (&port.port.name, wiring::detach(&port.port)));
        for (port, _) in outputs.chain(inputs).filter(|(_, detached)| detached.is_err()) {
            complain(slot.name, port);
        }
        ports.clients.iter().for_each(|port| port.disconnect());
    }
}
