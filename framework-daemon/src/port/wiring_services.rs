//! Service ports by name: all methods of an interface are connected and disconnected at once. Unlike a port of its own this
//! allocates: what belongs together is gathered.

use std::sync::Arc;

use component_sdk::status::Status;

use super::border::PortEnd;
use super::pattern::bundle::{self, Bundle, Mismatch};
use super::pattern::provider::Provider;
use super::pattern::requestor::Requestor;
use super::registry::{Entry, Registry};
use super::wiring::{Name, Refusal};

/// The methods, called or served, of a slot that others may wire. (A port of its own may have been taken off the list.)
#[derive(Default)]
struct Ends {
    clients: Vec<Arc<Requestor>>,
    servers: Vec<Arc<Provider>>,
}

impl Ends {
    fn of(registry: &Registry, slot: &str) -> Self {
        let mut ends = Self::default();
        let is_method = |entry: &&Entry| entry.slot == slot && entry.is_listed && entry.end.name().contains('/');
        for entry in registry.all().iter().filter(is_method) {
            match &entry.end {
                PortEnd::Requestor(port) => ends.clients.push(Arc::clone(port)),
                PortEnd::Provider(port) => ends.servers.push(Arc::clone(port)),
                _ => {}
            }
        }
        ends
    }

    /// True when one of them is a service of that name.
    fn have(&self, name: Name<'_>) -> bool {
        Bundle::find(&self.clients, name.port).is_some() || Bundle::find(&self.servers, name.port).is_some()
    }

    /// Takes the service off what it is connected to; false: none is required under that name.
    fn leave(&self, name: Name<'_>) -> bool {
        let found = Bundle::find(&self.clients, name.port);
        found.map(|client| client.ports().for_each(|port| port.disconnect())).is_some()
    }
}

/// Connects two services, whichever of them is named first; `unknown` says why the first name leads to no port of its own.
///
/// # Errors
/// Why they are not connected. What was to be connected has no connection then.
pub(super) fn connect(registry: &Registry, one: Name<'_>, other: Name<'_>, unknown: Refusal) -> Result<(), Refusal> {
    let (one, other) = (inner(registry, one), inner(registry, other));
    let (one, other) = (named(&one), named(&other));
    let (ends, others) = (Ends::of(registry, one.slot), Ends::of(registry, other.slot));
    if !ends.have(one) {
        return Err(unknown);
    }
    let joined = join(&ends.clients, one, &others.servers, other);
    if let Some(result) = joined.or_else(|| join(&others.clients, other, &ends.servers, one)) {
        return result;
    }
    ends.leave(one);
    if others.have(other) || registry.find(other.slot, other.port).is_ok() {
        return Err(no_pair(one, other));
    }
    let what = format_args!("{one} cannot be connected to {other}: there is no such port or service");
    Err(Refusal::new(Status::ServiceUnavailable, what))
}

/// True when that name is one of a service with methods.
pub(super) fn is_service(registry: &Registry, name: Name<'_>) -> bool {
    let name = inner(registry, name);
    Ends::of(registry, &name.0).have(named(&name))
}

/// Slot and name of the service that a composite shows by a name; any other name stands for itself.
fn inner(registry: &Registry, name: Name<'_>) -> (String, String) {
    registry.service(name.slot, name.port).unwrap_or_else(|| (name.slot.to_owned(), name.port.to_owned()))
}

fn named((slot, port): &(String, String)) -> Name<'_> {
    Name { slot, port }
}

/// Two ports, neither of which answers what the other one calls.
pub(super) fn no_pair(one: Name<'_>, other: Name<'_>) -> Refusal {
    let what = format_args!(
        "{one} and {other} cannot be connected: one must call the methods of a service, the other have them"
    );
    Refusal::new(Status::IncompatibleService, what)
}

fn join(
    clients: &[Arc<Requestor>],
    from: Name<'_>,
    servers: &[Arc<Provider>],
    to: Name<'_>,
) -> Option<Result<(), Refusal>> {
    let (client, server) = (Bundle::find(clients, from.port)?, Bundle::find(servers, to.port)?);
    // First, as with any other port: whatever follows, it is off what it was connected to.
    client.ports().for_each(|port| port.disconnect());
    let pairs = match bundle::pair(&client, &server) {
        Ok(pairs) => pairs,
        Err(mismatch) => return Some(Err(refusal(from, to, &mismatch))),
    };
    // They were compared: nothing is refused any more.
    Some(pairs.into_iter().try_for_each(|(client, server)| client.connect(server, None)).map_err(|difference| {
        Refusal::new(Status::IncompatibleService, format_args!("{from} cannot be connected to {to}: {difference}"))
    }))
}

fn refusal(from: Name<'_>, to: Name<'_>, Mismatch { asked, served, difference }: &Mismatch) -> Refusal {
    Refusal::new(Status::IncompatibleService, format_args!("{from} {asked}, {to} {served}: {difference}"))
}

/// Disconnects all methods of a required service; `unknown` says why the name leads to no port of its own.
///
/// # Errors
/// There is no such service, or it is a provided one.
pub(super) fn disconnect(registry: &Registry, name: Name<'_>, unknown: Refusal) -> Result<(), Refusal> {
    let name = inner(registry, name);
    let (ends, name) = (Ends::of(registry, &name.0), named(&name));
    if ends.leave(name) {
        return Ok(());
    }
    Err(if ends.have(name) { super::wiring::is_server(name) } else { unknown })
}
