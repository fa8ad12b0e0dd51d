//! Connections of event ports that are made while everything runs.

use component_sdk::status::Status;

use super::border::PortEnd;
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
        (PortEnd::EventServer(server), PortEnd::EventClient(client)) => client.connect(server).map_err(|difference| {
            let (asked, served) = (&client, &server);
            refused(format_args!(
                "{} asks for {} with {}, {} tells of {} for {}: {difference}",
                to.1, asked.event.name, asked.parameter.name, from.1, served.event.name, served.parameter.name
            ))
        }),
        _ => Err(refused(format_args!(
            "{} and {} cannot be connected: one is {}, the other {}",
            one.1,
            other.1,
            kind(one.0),
            kind(other.0)
        ))),
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
