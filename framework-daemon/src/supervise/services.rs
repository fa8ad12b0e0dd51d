//! Connections of service ports: from a client to its server.

use std::collections::HashMap;
use std::sync::Arc;

use super::system::{Placed, by_name};
use super::wiring::{all_listed, at, no_such_port};
use crate::port::pattern::bundle::{self, Bundle, Mismatch, Part};
use crate::port::pattern::provider::Provider;
use crate::port::pattern::requestor::Requestor;
use crate::profile::plan::{ConnectionPlan, OnGone, PortKind};

/// A client, its server, and whether the server's successor is asked again.
pub struct CallLink {
    from: Arc<Requestor>,
    to: Arc<Provider>,
    retry: Option<bool>,
}

/// Connections of service ports.
pub struct Calls {
    links: Vec<CallLink>,
    /// Clients that the plan before spoke of.
    known: Vec<Arc<Requestor>>,
}

/// Builds all connections of service ports. What neither this plan nor the one before it speaks of, somebody connected at run
/// time, and it stays so.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(
    before: &[ConnectionPlan],
    connections: &[ConnectionPlan],
    slots: &[Placed],
) -> Result<Calls, Vec<String>> {
    let names = by_name(slots);
    let (mut links, mut errors) = (Vec::new(), Vec::new());
    for connection in connections.iter().filter(|connection| connection.kind == PortKind::Service) {
        match link(connection, &names) {
            Ok(found) => links.extend(found),
            Err(reason) => errors.push(at(&connection.location, &reason)),
        }
    }
    let clients = |connection: &ConnectionPlan| {
        let slot = names.get(connection.source.slot.as_str())?;
        let found = Bundle::find(&slot.slot.requestors, &connection.source.port)?;
        Some(found.ports().cloned().collect::<Vec<_>>())
    };
    let known = before.iter().filter_map(clients).flatten().collect();
    if errors.is_empty() { Ok(Calls { links, known }) } else { Err(errors) }
}

/// One for each method of the client, or for the one port.
fn link(connection: &ConnectionPlan, slots: &HashMap<&str, &Placed>) -> Result<Vec<CallLink>, String> {
    let (from, to) = (&connection.source, &connection.target);
    let ends = slots.get(from.slot.as_str()).zip(slots.get(to.slot.as_str()));
    let (client, server) = ends.ok_or_else(|| no_such_port(connection))?;
    all_listed(connection, |end| slots.get(end.slot.as_str()).map(|placed| placed.slot.unlisted.clone()))?;
    let pairs =
        pair(connection, &client.slot.requestors, &server.slot.providers).ok_or_else(|| no_such_port(connection))??;
    let retry = connection.on_gone.map(|on_gone| on_gone == OnGone::Retry);
    let link =
        |(from, to): (&Arc<Requestor>, &Arc<Provider>)| CallLink { from: Arc::clone(from), to: Arc::clone(to), retry };
    Ok(pairs.into_iter().map(link).collect())
}

/// Each port of a connection's client with its server's; `None`: one of them is not there.
///
/// # Errors
/// Where they differ, with both sides.
pub(super) fn pair<'a, C: Part, S: Part>(
    connection: &ConnectionPlan,
    clients: &'a [C],
    servers: &'a [S],
) -> Option<Result<Vec<(&'a C, &'a S)>, String>> {
    let (from, to) = (&connection.source, &connection.target);
    let (client, server) = (Bundle::find(clients, &from.port)?, Bundle::find(servers, &to.port)?);
    Some(bundle::pair(&client, &server).map_err(|Mismatch { asked, served, difference }| {
        format!(
            "{}.{} {asked}, {}.{} {served}: {difference}; build both plugins against the same definition",
            from.slot, from.port, to.slot, to.port
        )
    }))
}

/// Puts the connections in place. One that was there before goes on, with the calls that are open over it.
pub fn apply(calls: &Calls, slots: &[Placed]) {
    let stays = |client: &Requestor| {
        let mut servers = slots.iter().flat_map(|placed| &placed.slot.providers);
        servers.any(|server| client.leads_to(server))
    };
    for client in slots.iter().flat_map(|placed| &placed.slot.requestors) {
        let is_it = |other: &Arc<Requestor>| Arc::ptr_eq(other, client);
        match calls.links.iter().find(|link| is_it(&link.from)) {
            Some(link) => {
                if let Err(reason) = client.connect(&link.to, link.retry) {
                    tracing::error!("port {}: {reason}", client.name);
                }
            }
            None if calls.known.iter().any(is_it) || !stays(client) => client.disconnect(),
            None => {}
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
    slots.iter().flat_map(|placed| &placed.slot.outputs).for_each(|port| port.replace());
}
