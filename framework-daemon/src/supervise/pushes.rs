//! Data ports of a slot, as class and profile describe them together: plain ones, push clients, servers with a cycle.

use std::sync::Arc;

use component_sdk::abi::class::{Direction, PortDecl};
use component_sdk::abi::push::PushEnd;

use super::wiring::{at, describe};
use crate::model::limits::{HANDLER_QUEUE_DEFAULT, WAIT};
use crate::model::time::nanoseconds;
use crate::port::check::Checks;
use crate::port::input::InPort;
use crate::port::output::OutPort;
use crate::port::pattern::outlet::{Cycle, Outlet};
use crate::port::pattern::subscriber::{Subscriber, Terms};
use crate::port::wait::Waiter;
use crate::profile::plan::{ComponentPlan, DataPortPlan, Overflow, PushPlan, Queue};

fn declared<'p>(decl: &PortDecl, component: &'p ComponentPlan) -> Option<&'p DataPortPlan> {
    component.data_ports.iter().find(|port| port.name == decl.name.as_str())
}

fn checks(decl: &PortDecl, declared: Option<&DataPortPlan>) -> Result<Checks, String> {
    declared.map_or(Ok(Checks::default()), |port| {
        Checks::compile(&port.validity, decl.object).map_err(|error| at(&port.location, &describe(&error)))
    })
}

/// What does not fit a port, though it would another one of its direction.
fn misfit(decl: &PortDecl, port: &DataPortPlan) -> Option<String> {
    let PushPlan { timeout, period, .. } = port.push;
    let is_client = decl.direction == Direction::Input && decl.push.end == PushEnd::Push;
    if period.is_some() && decl.push.end != PushEnd::Timed {
        return Some("<period> belongs to a PushTimedServer, which this port is not in the plugin".to_owned());
    }
    if timeout.is_some() && !is_client {
        return Some("<timeout> belongs to a PushClient, which this port is not in the plugin".to_owned());
    }
    (is_client && port.queue != Queue::Last)
        .then(|| "a PushClient keeps the newest value, as LAST: it has no FIFO".to_owned())
}

fn fitting<'p>(decl: &PortDecl, component: &'p ComponentPlan) -> Result<Option<&'p DataPortPlan>, String> {
    let declared = declared(decl, component);
    match declared.and_then(|port| Some((port, misfit(decl, port)?))) {
        Some((port, misfit)) => Err(at(&port.location, &format!("port `{}`: {misfit}", port.name))),
        None => Ok(declared),
    }
}

/// The profile's queue holds; where it says nothing of the port, the author's.
pub(super) fn input(decl: &PortDecl, component: &ComponentPlan, waiter: &Arc<Waiter>) -> Result<InPort, String> {
    let declared = fitting(decl, component)?;
    let push = declared.map(|port| port.push).unwrap_or_default();
    let is_client = decl.push.end == PushEnd::Push;
    let queue = match (declared, decl.fifo) {
        (Some(port), _) => port.queue,
        (None, size) if size > 0 && !is_client => Queue::Fifo { size, overflow: Overflow::DropOldest },
        (None, _) => Queue::Last,
    };
    let input = InPort::new(decl.name.as_str(), decl.object, queue, checks(decl, declared)?);
    let input = match declared.and_then(|port| port.max_age) {
        Some(max_age) => input.expecting(nanoseconds(max_age)),
        None => input,
    };
    Ok(match push.prescale {
        _ if is_client => input.subscribed_by(Subscriber::new(terms(decl, push), Arc::clone(waiter))),
        Some(prescale) if prescale > 1 => input.thinned(prescale),
        _ => input,
    })
}

fn terms(decl: &PortDecl, push: PushPlan) -> Terms {
    let room = if decl.fifo == 0 { HANDLER_QUEUE_DEFAULT } else { decl.fifo };
    Terms {
        prescale: push.prescale,
        timeout_ns: nanoseconds(push.timeout.unwrap_or(WAIT)),
        handler: (decl.push.prescale > 0).then_some((decl.push.prescale, room)),
    }
}

/// The profile's cycle holds; where it says nothing, the author's.
pub(super) fn output(decl: &PortDecl, component: &ComponentPlan, waiter: &Arc<Waiter>) -> Result<OutPort, String> {
    let declared = fitting(decl, component)?;
    let push = declared.map(|port| port.push).unwrap_or_default();
    let own = Cycle::of(&decl.push);
    let cycle = Cycle {
        period_ns: push.period.map(nanoseconds).or(own.period_ns),
        min_cycle_ns: push.min_cycle.map_or(own.min_cycle_ns, nanoseconds),
        ..own
    };
    let outlet = Outlet::new(cycle, Arc::clone(waiter));
    Ok(OutPort::serving(decl.name.as_str(), decl.object, checks(decl, declared)?, outlet))
}
