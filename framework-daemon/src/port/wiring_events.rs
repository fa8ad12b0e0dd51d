//! Connections of event ports that are made while everything runs.

use std::sync::Arc;

use component_sdk::status::Status;

use super::border::PortEnd;
use super::pattern::event_client::EventClient;
use super::pattern::event_server::EventServer;
use super::wiring::{Name, Refusal, join};

/// A port with its name.
type Named<'a> = (&'a PortEnd, Name<'a>);

/// Connects two ports of which at least one is an event port; `None`: none is.
pub(super) fn connect(one: Named<'_>, other: Named<'_>) -> Option<Result<(), Refusal>> {
    if !is_event(one.0) && !is_event(other.0) {
        return None;
    }
    let (from, to) = if one.0.receives() { (other, one) } else { (one, other) };
    Some(match (from.0, to.0) {
        (PortEnd::EventOut(output), PortEnd::EventIn(input)) => join(output, from.1, &input.port, to.1),
        (PortEnd::EventServer(server), PortEnd::EventClient(client)) => hear((server, from.1), (client, to.1)),
        _ => Err(refused(format_args!(
            "{} and {} cannot be connected: one is {}, the other {}",
            one.1,
            other.1,
            kind(one.0),
            kind(other.0)
        ))),
    })
}

/// A client hears of that server's events from now on. What it had activated is over, even if it is the same server.
fn hear((server, from): (&Arc<EventServer>, Name<'_>), (client, to): (&EventClient, Name<'_>)) -> Result<(), Refusal> {
    client.disconnect();
    client.connect(server).map_err(|difference| {
        refused(format_args!(
            "{to} asks for {} with {}, {from} tells of {} for {}: {difference}",
            client.event.name, client.parameter.name, server.event.name, server.parameter.name
        ))
    })
}

const fn is_event(end: &PortEnd) -> bool {
    matches!(end, PortEnd::EventClient(_) | PortEnd::EventServer(_) | PortEnd::EventIn(_) | PortEnd::EventOut(_))
}

/// A port in words.
const fn kind(end: &PortEnd) -> &'static str {
    match end {
        PortEnd::EventClient(_) => "a client of events",
        PortEnd::EventServer(_) => "a server of events",
        PortEnd::EventIn(_) => "an event input",
        PortEnd::EventOut(_) => "an event output",
        PortEnd::In(_) | PortEnd::Out(_) => "a data port",
        _ => "a service port",
    }
}

fn refused(reason: std::fmt::Arguments<'_>) -> Refusal {
    Refusal::new(Status::IncompatibleService, reason)
}
