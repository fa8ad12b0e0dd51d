//! Connections: layouts compared, checks compiled, links built; each output port gets its new set at once.

use std::collections::HashMap;
use std::sync::Arc;

use component_sdk::object::path::PathError;

use super::system::{Placed, by_name};
use crate::port::check::Checks;
use crate::port::output::Link;
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
    if let Some(difference) = source.object.difference(target.object) {
        return Err(format!(
            "{}.{} carries {}, {}.{} expects {}, and their layouts differ: {difference}; build both plugins against \
             the same definition",
            from.slot, from.port, source.object.name, to.slot, to.port, target.object.name
        ));
    }
    let checks = Checks::compile(&connection.validity, source.object).map_err(|error| describe(&error))?;
    Ok(((placed.slot.name, from.port.clone()), Link { target: Arc::clone(target), checks: Arc::new(checks) }))
}

/// Puts the links in place.
pub fn apply(mut wiring: Wiring, slots: &[Placed]) {
    for placed in slots {
        for port in &placed.slot.outputs {
            port.connect(wiring.remove(&(placed.slot.name, port.name.clone())).unwrap_or_default());
        }
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
