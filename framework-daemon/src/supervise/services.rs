//! Connections of service ports: from a client to its server.

use std::collections::HashMap;
use std::sync::Arc;

use super::system::{Placed, by_name};
use super::wiring::{at, no_such_port};
use crate::port::pattern::objects::Objects;
use crate::port::pattern::provider::Provider;
use crate::port::pattern::requestor::Requestor;
use crate::profile::plan::{ConnectionPlan, OnGone, PortKind};

/// A client, its server, and whether the server's successor is asked again.
pub struct CallLink {
    from: Arc<Requestor>,
    to: Arc<Provider>,
    retry: Option<bool>,
}

/// Builds all connections of service ports.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(connections: &[ConnectionPlan], slots: &[Placed]) -> Result<Vec<CallLink>, Vec<String>> {
    let names = by_name(slots);
    let (mut links, mut errors) = (Vec::new(), Vec::new());
    for connection in connections.iter().filter(|connection| connection.kind == PortKind::Service) {
        match link(connection, &names) {
            Ok(link) => links.push(link),
            Err(reason) => errors.push(at(&connection.location, &reason)),
        }
    }
    if errors.is_empty() { Ok(links) } else { Err(errors) }
}

fn link(connection: &ConnectionPlan, slots: &HashMap<&str, &Placed>) -> Result<CallLink, String> {
    let (from, to) = (&connection.source, &connection.target);
    let client = slots.get(from.slot.as_str()).and_then(|placed| placed.slot.requestor(&from.port));
    let server = slots.get(to.slot.as_str()).and_then(|placed| placed.slot.provider(&to.port));
    let (client, server) = client.zip(server).ok_or_else(|| no_such_port(connection))?;
    compare(connection, client.objects, server.objects)?;
    let retry = connection.on_gone.map(|on_gone| on_gone == OnGone::Retry);
    Ok(CallLink { from: Arc::clone(client), to: Arc::clone(server), retry })
}

/// Holds the objects of a client against those of its server.
///
/// # Errors
/// Where they differ, with both sides.
pub(super) fn compare(connection: &ConnectionPlan, asked: Objects, served: Objects) -> Result<(), String> {
    let (from, to) = (&connection.source, &connection.target);
    asked.difference(&served).map_or(Ok(()), |difference| {
        Err(format!(
            "{}.{} {}, {}.{} {}: {difference}; build both plugins against the same definition",
            from.slot,
            from.port,
            asked.asked(),
            to.slot,
            to.port,
            served.served()
        ))
    })
}

/// Puts the connections in place. One that was there before goes on, with the calls that are open over it.
pub fn apply(calls: &[CallLink], slots: &[Placed]) {
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

/// Takes all connections off clients that leave.
pub fn disconnect(slots: &[Placed]) {
    slots.iter().flat_map(|placed| &placed.slot.requestors).for_each(|port| port.disconnect());
}

/// Nobody is to wait any more for what slots that leave would answer.
pub fn replace_providers(slots: &[Placed]) {
    slots.iter().flat_map(|placed| &placed.slot.providers).for_each(|port| port.replace());
}
