//! Connections: layouts compared, checks compiled, links built; each output port gets its new set at once.

use std::collections::HashMap;
use std::sync::Arc;

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::PathError;

use super::blueprint::Blueprint;
use super::system::{Placed, by_name};
use crate::port::check::Checks;
use crate::port::output::{Link, OutPort};
use crate::profile::plan::{ConnectionPlan, Location, PortKind};

/// New links by slot and output port.
pub type Wiring = HashMap<(&'static str, String), Vec<Link>>;

/// Builds the links of all data connections; every output port of `slots` has an entry.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(connections: &[ConnectionPlan], slots: &[Placed]) -> Result<Wiring, Vec<String>> {
    let mut wiring = Wiring::new();
    for placed in slots {
        for port in &placed.slot.outputs {
            wiring.insert((placed.slot.name, port.name.clone()), Vec::new());
        }
    }
    let names = by_name(slots);
    let mut errors = Vec::new();
    for connection in connections.iter().filter(|connection| connection.kind == PortKind::Data) {
        match link(connection, &names) {
            Ok((key, link)) => wiring.entry(key).or_default().push(link),
            Err(reason) => errors.push(at(&connection.location, &reason)),
        }
    }
    if errors.is_empty() { Ok(wiring) } else { Err(errors) }
}

fn link(connection: &ConnectionPlan, slots: &HashMap<&str, &Placed>) -> Result<((&'static str, String), Link), String> {
    let (from, to) = (&connection.source, &connection.target);
    let source =
        slots.get(from.slot.as_str()).and_then(|placed| placed.slot.output(&from.port).map(|port| (placed, port)));
    let target = slots.get(to.slot.as_str()).and_then(|placed| placed.slot.input(&to.port));
    let ((placed, source), target) = source
        .zip(target)
        .ok_or_else(|| format!("{}.{} -> {}.{}: no such port", from.slot, from.port, to.slot, to.port))?;
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

/// What is wrong with the data connections of slots that do not exist yet.
#[must_use]
pub fn check(connections: &[ConnectionPlan], blueprints: &[Blueprint<'_>]) -> Vec<String> {
    let find = |slot: &str| blueprints.iter().find(|blueprint| blueprint.name() == slot);
    let wrong = |connection: &ConnectionPlan| {
        let (from, to) = (&connection.source, &connection.target);
        let written = find(&from.slot)?.output_object(&from.port)?;
        let expected = find(&to.slot)?.input_object(&to.port)?;
        compare(connection, written, expected).err().map(|reason| at(&connection.location, &reason))
    };
    connections.iter().filter(|connection| connection.kind == PortKind::Data).filter_map(wrong).collect()
}

/// Puts the links in place. A connection that was there before keeps its checks, with what they remember.
pub fn apply(mut wiring: Wiring, slots: &[Placed]) {
    for placed in slots {
        for port in &placed.slot.outputs {
            let mut links = wiring.remove(&(placed.slot.name, port.name.clone())).unwrap_or_default();
            let before = port.links();
            for link in &mut links {
                let same = |old: &&Link| Arc::ptr_eq(&old.target, &link.target) && old.checks.same_rules(&link.checks);
                if let Some(old) = before.iter().find(same) {
                    link.checks = Arc::clone(&old.checks);
                }
            }
            connect(placed, port, links);
        }
    }
}

fn connect(placed: &Placed, port: &OutPort, links: Vec<Link>) {
    if port.connect(links).is_err() {
        tracing::error!("{}.{}: its connections are being changed all the time", placed.slot.name, port.name);
    }
}

/// Takes all connections off slots that leave: their blocks may have to stay, others' ports not.
pub fn disconnect(slots: &[Placed]) {
    for placed in slots {
        placed.slot.outputs.iter().for_each(|port| connect(placed, port, Vec::new()));
    }
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
