//! Connections of plans: layouts compared, checks compiled, each reader given its writers.

use std::collections::HashMap;
use std::sync::Arc;

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::PathError;

use super::blueprint::Blueprint;
use super::events::{self, EventWiring};
use super::helpers::{self, Helpers};
use super::services::{self, Calls};
use super::system::{Placed, by_name};
use crate::fault::ports;
use crate::port::border::PortEnd;
use crate::port::check::Checks;
use crate::port::devices;
use crate::port::input::InPort;
use crate::port::registry::{Entry, Export, Registry};
use crate::port::wiring::{self, Planned};
use crate::profile::plan::{CompositePlan, ConnectionPlan, Location, Plan, PortKind, PortRef};

/// What plans say about one reader.
pub struct Reader {
    slot: &'static str,
    input: Arc<InPort>,
    writers: Vec<Planned>,
}

/// All connections of a plan.
pub struct Wiring {
    /// Readers that plans speak of.
    readers: Vec<Reader>,
    calls: Calls,
    events: EventWiring,
}

/// What the plan says about every reader that it or the one before it speaks of. What nobody speaks of, somebody connected at
/// run time, and it stays so.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(
    before: &[ConnectionPlan],
    connections: &[ConnectionPlan],
    slots: &[Placed],
    helpers: &Helpers,
) -> Result<Wiring, Vec<String>> {
    let names = by_name(slots);
    let is_data = |connection: &&ConnectionPlan| connection.kind == PortKind::Data;
    // In the plan's order, which is the order in which a writer serves its readers.
    let (mut readers, mut places, mut errors) = (Vec::new(), HashMap::new(), Vec::new());
    for PortRef { slot, port } in connections.iter().chain(before).filter(is_data).map(|connection| &connection.target)
    {
        if let Some(placed) = names.get(slot.as_str())
            && let Some(input) = placed.slot.input(port)
        {
            places.entry((slot, port)).or_insert_with(|| {
                readers.push(Reader { slot: placed.slot.name, input: Arc::clone(input), writers: Vec::new() });
                readers.len() - 1
            });
        }
    }
    for connection in connections.iter().filter(is_data) {
        match planned(connection, &names, helpers) {
            Ok(writer) => {
                let place = places.get(&(&connection.target.slot, &connection.target.port));
                if let Some(reader) = place.and_then(|place| readers.get_mut(*place)) {
                    reader.writers.push(writer);
                }
            }
            Err(reason) => errors.push(at(&connection.location, &reason)),
        }
    }
    let (calls, events) = (services::build(before, connections, slots), events::build(before, connections, slots));
    match (calls, events) {
        (Ok(calls), Ok(events)) if errors.is_empty() => Ok(Wiring { readers, calls, events }),
        (calls, events) => {
            errors.extend(calls.err().into_iter().flatten().chain(events.err().into_iter().flatten()));
            Err(errors)
        }
    }
}

fn planned(connection: &ConnectionPlan, slots: &HashMap<&str, &Placed>, helpers: &Helpers) -> Result<Planned, String> {
    let (from, to) = (&connection.source, &connection.target);
    let source = slots.get(from.slot.as_str()).and_then(|placed| placed.slot.output(&from.port));
    let source = source.or_else(|| helpers.output(from));
    let target = slots.get(to.slot.as_str()).and_then(|placed| placed.slot.input(&to.port));
    let (source, target) = source.zip(target).ok_or_else(|| no_such_port(connection))?;
    all_listed(connection, |end| slots.get(end.slot.as_str()).map(|placed| placed.slot.unlisted.clone()))?;
    let checks = compare(connection, source.object, target.object)?;
    Ok(Planned { output: Arc::clone(source), checks: Arc::new(checks) })
}

pub(super) fn no_such_port(connection: &ConnectionPlan) -> String {
    let (from, to) = (&connection.source, &connection.target);
    format!("{}.{} -> {}.{}: no such port", from.slot, from.port, to.slot, to.port)
}

/// A port that its component keeps for itself is not connected by a profile.
pub(super) fn all_listed(
    connection: &ConnectionPlan,
    unlisted: impl Fn(&PortRef) -> Option<Vec<&'static str>>,
) -> Result<(), String> {
    let ends = [&connection.source, &connection.target].into_iter();
    let hidden = |end: &&PortRef| unlisted(end).is_some_and(|names| names.contains(&end.port.as_str()));
    ends.into_iter().find(hidden).map_or(Ok(()), |PortRef { slot, port }| {
        Err(format!("{slot}.{port} is `unlisted` in its class: the component connects it itself, no profile does"))
    })
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
pub fn check(plan: &Plan, blueprints: &[Blueprint<'_>]) -> Vec<String> {
    let connections = &plan.connections;
    let find = |slot: &str| blueprints.iter().find(|blueprint| blueprint.name() == slot);
    let wrong = |connection: &ConnectionPlan| {
        let (from, to) = (&connection.source, &connection.target);
        let target = find(&to.slot)?;
        let Some(source) = find(&from.slot) else {
            let (written, expected) = (helpers::object(plan, blueprints, from)?, target.input_object(&to.port)?);
            return compare(connection, written, expected).err().map(|reason| at(&connection.location, &reason));
        };
        if let Err(reason) = all_listed(connection, |end| find(&end.slot).map(|slot| slot.class.unlisted())) {
            return Some(at(&connection.location, &reason));
        }
        let result = match connection.kind {
            PortKind::Data => {
                let (written, expected) = (source.output_object(&from.port)?, target.input_object(&to.port)?);
                compare(connection, written, expected).map(|_| ())
            }
            PortKind::Service => services::pair(connection, &source.requestors, &target.providers)?.map(drop),
            PortKind::Event => events::check(connection, source, target),
        };
        result.err().map(|reason| at(&connection.location, &reason))
    };
    let mut all: Vec<String> = connections.iter().filter_map(wrong).collect();
    all.extend(events::check_clients(connections, blueprints));
    all.extend(helpers::check(plan, blueprints));
    all
}

/// Puts the connections in place. One that was there before keeps its checks, with what they remember.
pub fn apply(wiring: &Wiring, slots: &[Placed]) {
    for Reader { slot, input, writers } in &wiring.readers {
        if wiring::set(input, writers).is_err() {
            complain(slot, &input.name);
        }
    }
    services::apply(&wiring.calls, slots);
    events::apply(&wiring.events);
}

pub(super) fn complain(slot: &str, port: &str) {
    tracing::error!("{slot}.{port}: it is being wired all the time, and not as its plan says");
}

/// Takes all connections off slots that leave: their blocks may have to stay, others' ports not.
pub fn disconnect(slots: &[Placed]) {
    for Placed { slot, .. } in slots {
        let outputs = slot.outputs.iter().map(|port| (&port.name, wiring::detach_all(port)));
        let inputs = slot.inputs.iter().map(|port| (&port.name, wiring::detach(port)));
        for (port, _) in outputs.chain(inputs).filter(|(_, detached)| detached.is_err()) {
            complain(slot.name, port);
        }
    }
    services::disconnect(slots);
    events::disconnect(slots);
}

/// Tells whoever wires at run time which ports there are, and which of them composites show.
pub fn announce(registry: &Registry, slots: &[Placed], helpers: &Helpers, composites: &[CompositePlan]) {
    let manager = ports::shared().slot();
    let entries = slots.iter().map(|placed| &placed.slot).chain([manager]).flat_map(|slot| slot.entries());
    let voters = helpers.named().map(|(slot, voter)| {
        let end = PortEnd::Out(Arc::clone(&voter.helper.parts().output));
        Entry { slot, end, is_listed: true }
    });
    let exports = composites.iter().flat_map(|composite| exports(composite, slots, helpers)).collect();
    if registry.set_all(entries.chain(voters).collect(), exports).is_err() {
        tracing::error!("the names of the ports are being changed all the time");
    }
    if devices::announce(slots.iter().map(|placed| (placed.slot.name, Arc::clone(&placed.slot.devices)))).is_err() {
        tracing::error!("the slots are being changed all the time: devices that are lost are not told of");
    }
}

/// What a composite shows: each name once, with all that it stands for. What a component keeps for itself is not shown.
fn exports(composite: &CompositePlan, slots: &[Placed], helpers: &Helpers) -> Vec<Export> {
    let mut shown: Vec<Export> = Vec::new();
    for (name, inner) in &composite.exports {
        let Some(placed) = slots.iter().find(|placed| placed.slot.name == inner.slot) else {
            let (composite, port) = (composite.name.clone(), name.clone());
            let ends: Vec<_> =
                helpers.output(inner).map(|output| PortEnd::Out(Arc::clone(output))).into_iter().collect();
            shown.extend((!ends.is_empty()).then_some(Export { composite, port, ends, service: None }));
            continue;
        };
        let listed = !placed.slot.unlisted.contains(&inner.port.as_str());
        let found = placed.slot.ends().find(|end| listed && end.name() == inner.port);
        // A service's ports are those of its methods.
        let is_method = |end: PortEnd| end.name().split_once('/').is_some_and(|(service, _)| service == inner.port);
        let is_service = found.is_none() && placed.slot.ends().any(is_method);
        match (found, shown.iter_mut().find(|export| export.port == *name)) {
            (Some(end), Some(export)) => export.ends.push(end),
            (None, _) if !is_service => {}
            (found, _) => shown.push(Export {
                composite: composite.name.clone(),
                port: name.clone(),
                ends: found.into_iter().collect(),
                service: is_service.then(|| (inner.slot.clone(), inner.port.clone())),
            }),
        }
    }
    shown
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
        PathError::Several => format!("validity limit of `{field}`: it holds several numbers: name one, `{field}[0]`"),
        PathError::NoPlace { count: 0, .. } => format!("validity field `{field}` has no places: it is one number"),
        PathError::NoPlace { place, count } => {
            format!("validity field `{field}`: there is no place {place}: it holds {count} numbers, from place 0 on")
        }
    }
}

/// `file:line:column: error: reason`.
#[must_use]
pub fn at(location: &Location, reason: &str) -> String {
    format!("{}:{}:{}: error: {reason}", location.file.display(), location.line, location.column)
}
