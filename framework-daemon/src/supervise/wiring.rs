//! Connections: layouts compared, checks compiled, links built; each output port gets its new set at once.

use std::collections::HashMap;
use std::sync::Arc;

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::PathError;

use super::blueprint::Blueprint;
use super::system::{Placed, by_name};
use crate::port::check::Checks;
use crate::port::output::Link;
use crate::port::pattern::provider::Provider;
use crate::port::pattern::requestor::{self, Requestor};
use crate::profile::plan::{ConnectionPlan, Location, OnGone, PortKind};

/// New connections.
#[derive(Default)]
pub struct Wiring {
    /// Links by slot and output port; every output port has an entry.
    links: HashMap<(&'static str, String), Vec<Link>>,
    calls: Vec<CallLink>,
}

/// A client, its server, and whether the server's successor is asked again.
struct CallLink {
    from: Arc<Requestor>,
    to: Arc<Provider>,
    retry: Option<bool>,
}

/// Builds all connections of data and service ports.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(connections: &[ConnectionPlan], slots: &[Placed]) -> Result<Wiring, Vec<String>> {
    let mut wiring = Wiring::default();
    for placed in slots {
        for port in &placed.slot.outputs {
            wiring.links.insert((placed.slot.name, port.name.clone()), Vec::new());
        }
    }
    let names = by_name(slots);
    let mut errors = Vec::new();
    for connection in connections {
        let added = match connection.kind {
            PortKind::Data => {
                link(connection, &names).map(|(key, link)| wiring.links.entry(key).or_default().push(link))
            }
            PortKind::Service => call_link(connection, &names).map(|link| wiring.calls.push(link)),
            PortKind::Event => Ok(()),
        };
        if let Err(reason) = added {
            errors.push(at(&connection.location, &reason));
        }
    }
    if errors.is_empty() { Ok(wiring) } else { Err(errors) }
}

fn call_link(connection: &ConnectionPlan, slots: &HashMap<&str, &Placed>) -> Result<CallLink, String> {
    let (from, to) = (&connection.source, &connection.target);
    let client = slots.get(from.slot.as_str()).and_then(|placed| placed.slot.requestor(&from.port));
    let server = slots.get(to.slot.as_str()).and_then(|placed| placed.slot.provider(&to.port));
    let (client, server) = client.zip(server).ok_or_else(|| no_such_port(connection))?;
    compare_calls(connection, (client.request, client.answer), (server.request, server.answer))?;
    let retry = connection.on_gone.map(|on_gone| on_gone == OnGone::Retry);
    Ok(CallLink { from: Arc::clone(client), to: Arc::clone(server), retry })
}

fn no_such_port(connection: &ConnectionPlan) -> String {
    let (from, to) = (&connection.source, &connection.target);
    format!("{}.{} -> {}.{}: no such port", from.slot, from.port, to.slot, to.port)
}

/// Request and answer of a port.
type Objects = (&'static TypeDescriptor, &'static TypeDescriptor);

/// Holds the objects of a client against those of its server.
fn compare_calls(connection: &ConnectionPlan, asked: Objects, served: Objects) -> Result<(), String> {
    let (from, to) = (&connection.source, &connection.target);
    requestor::difference(asked, served).map_or(Ok(()), |difference| {
        Err(format!(
            "{}.{} asks {} for {}, {}.{} answers {} with {}: {difference}; build both plugins against the same definition",
            from.slot, from.port, asked.0.name, asked.1.name, to.slot, to.port, served.0.name, served.1.name
        ))
    })
}

fn link(connection: &ConnectionPlan, slots: &HashMap<&str, &Placed>) -> Result<((&'static str, String), Link), String> {
    let (from, to) = (&connection.source, &connection.target);
    let source =
        slots.get(from.slot.as_str()).and_then(|placed| placed.slot.output(&from.port).map(|port| (placed, port)));
    let target = slots.get(to.slot.as_str()).and_then(|placed| placed.slot.input(&to.port));
    let ((placed, source), target) = source.zip(target).ok_or_else(|| no_such_port(connection))?;
    let checks = compare(connection, source.object, target.object)?;
    Ok(((placed.slot.name, from.port.clone()), Link { target: Arc::clone(target), checks: Arc::new(checks) }))
}

/// Holds the layouts of both ends against each other and compiles the connection's checks.
fn compare(
    connection: &ConnectionPlan,
    written: &'static TypeDescriptor,
    expected: &'static TypeDescriptor,
) -> Result<Checks, String> {
    let (from, to) = (&connection.source, &connection.target);
    if let Some(difference) = written.difference(expected) {
        return Err(format!(
            "{}.{} carries {}, {}.{} expects {}, and their layouts differ: {difference}; build both plugins against \
             the same definition",
            from.slot, from.port, written.name, to.slot, to.port, expected.name
        ));
    }
    Checks::compile(&connection.validity, written).map_err(|error| describe(&error))
}

/// What is wrong with the connections of slots that do not exist yet.
#[must_use]
pub fn check(connections: &[ConnectionPlan], blueprints: &[Blueprint<'_>]) -> Vec<String> {
    let find = |slot: &str| blueprints.iter().find(|blueprint| blueprint.name() == slot);
    let wrong = |connection: &ConnectionPlan| {
        let (from, to) = (&connection.source, &connection.target);
        let (source, target) = (find(&from.slot)?, find(&to.slot)?);
        let result = match connection.kind {
            PortKind::Data => {
                let (written, expected) = (source.output_object(&from.port)?, target.input_object(&to.port)?);
                compare(connection, written, expected).map(|_| ())
            }
            PortKind::Service => {
                let client = source.requestors.iter().find(|port| port.name == from.port)?;
                let server = target.providers.iter().find(|port| port.name == to.port)?;
                compare_calls(connection, (client.request, client.answer), (server.request, server.answer))
            }
            PortKind::Event => Ok(()),
        };
        result.err().map(|reason| at(&connection.location, &reason))
    };
    connections.iter().filter_map(wrong).collect()
}

/// Puts the links in place. A connection that was there before keeps its checks, with what they remember.
pub fn apply(mut wiring: Wiring, slots: &[Placed]) {
    for placed in slots {
        for port in &placed.slot.outputs {
            let mut links = wiring.links.remove(&(placed.slot.name, port.name.clone())).unwrap_or_default();
            let before = port.links();
            for link in &mut links {
                let same = |old: &&Link| Arc::ptr_eq(&old.target, &link.target) && old.checks.same_rules(&link.checks);
                if let Some(old) = before.iter().find(same) {
                    link.checks = Arc::clone(&old.checks);
                }
            }
            port.connect(links);
        }
    }
    apply_calls(&wiring.calls, slots);
}

/// One that was there before goes on, with the calls that are open over it.
fn apply_calls(calls: &[CallLink], slots: &[Placed]) {
    for client in slots.iter().flat_map(|placed| &placed.slot.requestors) {
        match calls.iter().find(|link| Arc::ptr_eq(&link.from, client)) {
            Some(link) => {
                if let Err(reason) = client.connect(&link.to, link.retry) {
                    tracing::error!("port {}: {reason}", client.name);
                }
            }
            None => client.disconnect(),
        }
    }
}

/// Takes all connections off slots that leave: their blocks may have to stay, others' ports not.
pub fn disconnect(slots: &[Placed]) {
    slots.iter().flat_map(|placed| &placed.slot.outputs).for_each(|port| port.connect(Vec::new()));
    slots.iter().flat_map(|placed| &placed.slot.requestors).for_each(|port| port.disconnect());
}

/// Nobody is to wait any more for what slots that leave would answer.
pub fn replace_providers(slots: &[Placed]) {
    slots.iter().flat_map(|placed| &placed.slot.providers).for_each(|port| port.replace());
}

/// What is wrong with a `field` of a `validity`.
#[must_use]
pub fn describe((field, error): &(String, PathError)) -> String {
    match error {
        PathError::Unknown { part, known } if known.is_empty() => {
            format!("validity field `{field}`: `{part}` has no fields")
        }
        PathError::Unknown { part, known } => {
            format!("validity field `{field}`: no field `{part}`; there are: {}", known.join(", "))
        }
        PathError::NoNumber => format!("validity field `{field}` holds no numbers: name a field inside it"),
    }
}

/// `file:line:column: error: reason`.
#[must_use]
pub fn at(location: &Location, reason: &str) -> String {
    format!("{}:{}:{}: error: {reason}", location.file.display(), location.line, location.column)
}
