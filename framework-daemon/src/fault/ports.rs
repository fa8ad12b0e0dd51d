//! The fault manager's ports: those of a slot that has no component, `fault_manager`. Any component's event ports can be
//! connected to them, in a profile or at run time, as to those of any other slot.
//!
//! - `faults` tells those who ask with a filter, `all_faults` everybody of each fault, when it is in the journal. Nobody is
//!   waited for: what a subscriber's queue cannot take is lost to that one, and its port counts it.
//! - `report` takes what components say of others. The slot that they name is charged with the symptom `raised`: its
//!   executor answers it by its own rules, and the evidence says who reported it. That is whose port the report came
//!   through; what it says of itself does not count.

use std::sync::{Arc, LazyLock};

use component_sdk::object::CommObject;
use component_sdk::objects::{FaultFilter, FaultNotice, FaultReport};
use crossbeam_channel::{Receiver, Sender, bounded};

use crate::exec::slot::{Slot, Status};
use crate::exec::task::Tasks;
use crate::model::fault::{Evidence, Fault, FaultEvent, Outcome, ShortText};
use crate::model::limits::FAULT_REPORTS;
use crate::model::names::FAULT_MANAGER;
use crate::model::symptom::{SeverityTable, Symptom};
use crate::port::charge::Charges;
use crate::port::check::Checks;
use crate::port::devices::Devices;
use crate::port::event_ends::EventEnds;
use crate::port::event_in::EventIn;
use crate::port::input::{InPort, Listener};
use crate::port::output::OutPort;
use crate::port::own::Plain;
use crate::port::pattern::event_server::EventServer;
use crate::port::pattern::provider::Openness;
use crate::port::wait::Waiter;
use crate::profile::plan::{Overflow, Queue};
use crate::sys::bell::{Bell, Signal, Wakes};
use crate::sys::clock;

impl Plain for FaultNotice {}
impl Plain for FaultFilter {}
impl Plain for FaultReport {}

/// The ports, as the fault manager has them.
pub struct Ports {
    slot: Arc<Slot>,
    faults: Arc<EventServer>,
    all_faults: Arc<OutPort>,
    report: Arc<InPort>,
    rung: Receiver<()>,
}

/// Those of the fault manager that runs in this process.
pub fn shared() -> &'static Ports {
    static SHARED: LazyLock<Ports> = LazyLock::new(Ports::default);
    &SHARED
}

/// Wakes the fault manager; one ring is enough for all that waits.
struct Doorbell(Sender<()>);

impl Listener for Doorbell {
    fn data_arrived<'a>(&'a self, _: &mut Wakes<'a>) {
        let _ = self.0.try_send(());
    }
}

impl Default for Ports {
    fn default() -> Self {
        let waiter = Waiter::new();
        let faults =
            EventServer::new("faults", FaultFilter::DESCRIPTOR, FaultNotice::DESCRIPTOR, false, Arc::clone(&waiter));
        faults.set_open(Openness::Serving);
        let all_faults = OutPort::new("all_faults", FaultNotice::DESCRIPTOR, Checks::default());
        let queue = Queue::Fifo { size: FAULT_REPORTS, overflow: Overflow::DropOldest };
        let report = EventIn::new(InPort::new("report", FaultReport::DESCRIPTOR, queue, Checks::default()), false);
        let (rings, rung) = bounded(1);
        report.port.listen(Box::new(Doorbell(rings)));
        let (faults, all_faults, report) = (Arc::new(faults), Arc::new(all_faults), Arc::new(report));
        let input = Arc::clone(&report.port);
        let mut events = EventEnds::default();
        events.servers.push(Arc::clone(&faults));
        events.outputs.push(Arc::clone(&all_faults));
        events.inputs.push(report);
        Self { slot: Arc::new(slot(events, waiter)), faults, all_faults, report: input, rung }
    }
}

/// A slot that nothing runs in.
fn slot(events: EventEnds, waiter: Arc<Waiter>) -> Slot {
    let signal = Signal::new(Bell::new());
    let charges = Arc::new(Charges::new(FAULT_MANAGER, Arc::clone(&signal), &SeverityTable::default()));
    Slot {
        name: FAULT_MANAGER,
        inputs: Vec::new(),
        outputs: Vec::new(),
        requestors: Vec::new(),
        providers: Vec::new(),
        unlisted: Vec::new(),
        events,
        devices: Arc::new(Devices::new(Arc::clone(&charges))),
        charges,
        tasks: Arc::new(Tasks::new(FAULT_MANAGER, signal, waiter)),
        handles_pushes: false,
        status: Status::new(vec![FAULT_MANAGER]),
    }
}

impl Ports {
    /// The slot, for who connects its ports.
    #[must_use]
    pub const fn slot(&self) -> &Arc<Slot> {
        &self.slot
    }

    /// Where it is told that a report has come.
    #[must_use]
    pub const fn rung(&self) -> &Receiver<()> {
        &self.rung
    }

    /// Tells of a fault that is in the journal by that number.
    pub fn tell(&self, event: &FaultEvent, sequence: u64, message: &str) {
        let mut notice = FaultNotice::new(sequence, event.fault.at_ns, event.slot, event.fault.symptom.name());
        notice = notice.with(event.severity.name(), outcome(event.outcome), message);
        notice.recovered_ns = event.times.first_callback_ns.unwrap_or_default();
        self.faults.put(|filter: &FaultFilter| filter.matches(&notice).then_some(notice));
        self.all_faults.send_own(notice);
    }

    /// Charges the slots that were reported.
    pub fn hear(&self, slots: &[Arc<Slot>]) {
        loop {
            let mut reporter = None;
            let writer = |slot: &&Arc<Slot>, is_its: &dyn Fn(&OutPort) -> bool| {
                slot.events.outputs.iter().any(|port| is_its(port))
            };
            let report = self.report.take_own::<FaultReport>(|is_its| {
                reporter = slots.iter().find(|slot| writer(slot, is_its));
            });
            let Some(report) = report else { return };
            let from = reporter.map_or("a slot that is gone", |slot| slot.name);
            let blamed = slots.iter().find(|slot| slot.name == report.slot());
            let Some(blamed) = blamed.or(reporter.filter(|_| report.slot().is_empty())) else {
                tracing::warn!(
                    "slot {from} reports a fault of `{}`, and there is no such slot: {}",
                    report.slot(),
                    report.message()
                );
                continue;
            };
            let message = ShortText::new(&format!("{from} reports: {}", report.message()));
            let fault = Fault::told(Symptom::Raised, clock::now_ns(), Evidence::Text { message });
            if !blamed.charge(&fault) {
                tracing::warn!("slot {}: too many faults of it wait already; what {from} reports is lost", blamed.name);
            }
        }
    }
}

const fn outcome(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Recovered => "recovered",
        Outcome::Stopped => "stopped",
        Outcome::Ignored => "ignored",
        Outcome::Failed => "failed",
        Outcome::Consequence => "consequence",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::plan::PortKind;
    use crate::profile::wire;

    #[test]
    fn profiles_know_its_ports() {
        let ports = wire::ports_of_fault_manager();
        assert!(ports.iter().all(|port| port.kind == PortKind::Event && port.end.slot == FAULT_MANAGER));
        for end in shared().slot().events.ends() {
            let known = ports.iter().find(|port| port.name == end.name()).unwrap();
            assert_eq!(known.is_source, !end.receives(), "{}", known.name);
        }
        assert_eq!(ports.len(), shared().slot().events.ends().count());
    }
}
