//! A slot as everybody sees it: name, ports, counters. The instance that fills it may change; this stays.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, AtomicUsize, Ordering};

use super::task::Tasks;
use crate::model::fault::Memory;
use crate::model::lifecycle::State;
use crate::port::border::PortEnd;
use crate::port::charge::Charges;
use crate::port::devices::Devices;
use crate::port::event_ends::EventEnds;
use crate::port::input::InPort;
use crate::port::output::OutPort;
use crate::port::pattern::provider::Provider;
use crate::port::pattern::requestor::Requestor;
use crate::port::registry::Entry;

/// A named place in an application.
pub struct Slot {
    /// Its name.
    pub name: &'static str,
    /// Inputs.
    pub inputs: Vec<Arc<InPort>>,
    /// Outputs.
    pub outputs: Vec<Arc<OutPort>>,
    /// Clients, of queries and messages.
    pub requestors: Vec<Arc<Requestor>>,
    /// Servers, of queries and messages.
    pub providers: Vec<Arc<Provider>>,
    /// Names of the ports that others do not find until the component says so.
    pub unlisted: Vec<&'static str>,
    /// Event ports.
    pub events: EventEnds,
    /// What others charge it with.
    pub charges: Arc<Charges>,
    /// Its component's devices.
    pub devices: Arc<Devices>,
    /// Threads of its component.
    pub tasks: Arc<Tasks>,
    /// Values that arrive, or cycles that begin, enter a handler of it.
    pub handles_pushes: bool,
    /// Counters.
    pub status: Status,
}

impl Slot {
    /// The input of that name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&Arc<InPort>> {
        self.inputs.iter().find(|port| port.name == name)
    }

    /// The output of that name.
    #[must_use]
    pub fn output(&self, name: &str) -> Option<&Arc<OutPort>> {
        self.outputs.iter().find(|port| port.name == name)
    }

    /// True where something may come in that a handler is entered for.
    #[must_use]
    #[inline]
    pub const fn serves(&self) -> bool {
        self.handles_pushes || !self.providers.is_empty() || !self.events.is_empty()
    }

    /// What receives every value or event at the port of that name, and counts it.
    #[must_use]
    pub fn reader(&self, name: &str) -> Option<&Arc<InPort>> {
        self.input(name).or_else(|| self.events.input(name))
    }

    /// What sends values or events at the port of that name.
    #[must_use]
    pub fn writer(&self, name: &str) -> Option<&Arc<OutPort>> {
        self.output(name).or_else(|| self.events.output(name))
    }

    /// The client of that name.
    #[must_use]
    pub fn requestor(&self, name: &str) -> Option<&Arc<Requestor>> {
        self.requestors.iter().find(|port| port.name == name)
    }

    /// The server of that name.
    #[must_use]
    pub fn provider(&self, name: &str) -> Option<&Arc<Provider>> {
        self.providers.iter().find(|port| port.name == name)
    }

    /// All of its ports: inputs, outputs, clients, servers, then those of events likewise.
    pub fn ends(&self) -> impl Iterator<Item = PortEnd> + '_ {
        let inputs = self.inputs.iter().cloned().map(PortEnd::In);
        let data = inputs.chain(self.outputs.iter().cloned().map(PortEnd::Out));
        let clients = self.requestors.iter().cloned().map(PortEnd::Requestor);
        let services = clients.chain(self.providers.iter().cloned().map(PortEnd::Provider));
        data.chain(services).chain(self.events.ends())
    }

    /// The same, as whoever wires at run time is told of them.
    pub fn entries(&self) -> impl Iterator<Item = Entry> + '_ {
        self.ends().map(|end| Entry { slot: self.name, is_listed: !self.unlisted.contains(&end.name()), end })
    }

    /// The port of that name, of whatever pattern: what receives, or what sends.
    #[must_use]
    pub fn end(&self, name: &str, input: bool) -> Option<PortEnd> {
        let data = if input {
            self.input(name).cloned().map(PortEnd::In)
        } else {
            self.output(name).cloned().map(PortEnd::Out)
        };
        let service = || {
            if input {
                self.provider(name).cloned().map(PortEnd::Provider)
            } else {
                self.requestor(name).cloned().map(PortEnd::Requestor)
            }
        };
        data.or_else(service).or_else(|| self.events.end(name, input))
    }
}

/// What a slot has done. Written by its executor, read by anybody.
#[derive(Debug)]
pub struct Status {
    state: AtomicU8,
    /// Names of the classes that may fill it; the first is the primary's.
    classes: Box<[&'static str]>,
    class: AtomicUsize,
    /// Completed `on_execute`.
    pub cycles: AtomicU64,
    /// Periods that began too late and were left out.
    pub missed: AtomicU64,
    /// Faults blamed on it.
    pub faults: AtomicU64,
    /// Instances that are never entered again and never freed.
    pub quarantined: AtomicU64,
    /// Faults after which memory may be damaged.
    pub tainted: AtomicU64,
    /// Longest `on_execute` in nanoseconds, of those that were measured exactly: all of periodic slots and of those with a
    /// deadline, one of sixteen otherwise. The others count with what they took at least, which is up to 10 ms less.
    pub longest_ns: AtomicU64,
    /// How long its recoveries took.
    pub recovery: Recovery,
}

/// How long recoveries took, fault to first good callback, against what was declared. Written by the slot's executor.
#[derive(Debug, Default)]
pub struct Recovery {
    /// The last one, in nanoseconds; 0: there was none.
    pub last_ns: AtomicU64,
    /// The longest one, in nanoseconds.
    pub worst_ns: AtomicU64,
    /// Those that took longer than declared.
    pub late: AtomicU64,
}

impl Recovery {
    /// Notes one.
    pub fn note(&self, took_ns: u64, is_late: bool) {
        self.last_ns.store(took_ns, Ordering::Relaxed);
        self.worst_ns.fetch_max(took_ns, Ordering::Relaxed);
        self.late.fetch_add(u64::from(is_late), Ordering::Relaxed);
    }
}

impl Status {
    /// Of a slot that instances of these classes may fill, the first one at first.
    #[must_use]
    pub fn new(classes: Vec<&'static str>) -> Self {
        Self {
            state: AtomicU8::new(State::Created as u8),
            classes: classes.into(),
            class: AtomicUsize::new(0),
            cycles: AtomicU64::new(0),
            missed: AtomicU64::new(0),
            faults: AtomicU64::new(0),
            quarantined: AtomicU64::new(0),
            tainted: AtomicU64::new(0),
            longest_ns: AtomicU64::new(0),
            recovery: Recovery::default(),
        }
    }

    /// Where it is in its lifecycle.
    #[must_use]
    pub fn state(&self) -> State {
        State::from_number(self.state.load(Ordering::Acquire))
    }

    /// Sets the state.
    pub fn set_state(&self, state: State) {
        self.state.store(state as u8, Ordering::Release);
    }

    /// The class of the instance that fills it.
    #[must_use]
    pub fn class(&self) -> &'static str {
        self.classes.get(self.class.load(Ordering::Acquire)).copied().unwrap_or_default()
    }

    /// Sets the class, by its number.
    pub fn set_class(&self, number: usize) {
        self.class.store(number, Ordering::Release);
    }

    /// Counts a fault after which memory may be damaged, if it is one.
    pub fn count_taint(&self, memory: Memory) {
        self.tainted.fetch_add(u64::from(memory == Memory::Suspect), Ordering::Relaxed);
    }

    /// Counts an `on_execute` that took so long. By the slot's executor, which is the only one to count them.
    #[inline]
    pub fn count_cycle(&self, took_ns: u64) {
        self.cycles.store(self.cycles.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        if took_ns > self.longest_ns.load(Ordering::Relaxed) {
            self.longest_ns.store(took_ns, Ordering::Relaxed);
        }
    }

    /// Counts one.
    pub fn count(counter: &AtomicU64) {
        counter.fetch_add(1, Ordering::Relaxed);
    }
}
