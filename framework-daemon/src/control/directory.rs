//! What the control socket looks at: the slots that run, as they were at the last boot or reload. Counters, states and
//! connections in it are live.
//!
//! The last holder of a slot frees values that plugins made, by code of theirs; so that this is never the control thread, the
//! main loop keeps every directory that it replaced until nobody else holds it.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::exec::slot::Slot;
use crate::exec::workshop::Shelf;
use crate::fault::ports;
use crate::port::output::OutPort;
use crate::profile::plan::{CompositePlan, Plan, PortRef, SlotPlan};
use crate::profile::suggest;
use crate::supervise::helpers::Helpers;
use crate::supervise::system::System;

/// All that runs.
pub struct Directory {
    /// Slots in the order in which they were started.
    pub entries: Vec<Entry>,
    /// Models and voters among them.
    pub helpers: Helpers,
    plan: Arc<Plan>,
    places: HashMap<&'static str, usize>,
}

/// A slot with what is not in it.
pub struct Entry {
    /// The slot.
    pub slot: Arc<Slot>,
    /// Its spares.
    pub shelf: Arc<Shelf>,
    plan: usize,
}

/// The other end of a connection.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct End {
    /// The slot.
    pub slot: &'static str,
    /// The port.
    pub port: String,
}

impl std::fmt::Display for End {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}.{}", self.slot, self.port)
    }
}

impl Directory {
    /// Of what runs now.
    #[must_use]
    pub fn of(system: &System) -> Self {
        let plans: HashMap<&str, usize> =
            system.plan.slots.iter().enumerate().map(|(place, plan)| (plan.name.as_str(), place)).collect();
        let entry = |placed: &crate::supervise::system::Placed| {
            let plan = *plans.get(placed.slot.name)?;
            Some(Entry { slot: Arc::clone(&placed.slot), shelf: Arc::clone(&placed.shelf), plan })
        };
        let entries: Vec<Entry> = system.slots.iter().filter_map(entry).collect();
        let places = entries.iter().enumerate().map(|(place, entry)| (entry.slot.name, place)).collect();
        Self { entries, helpers: system.helpers.clone(), plan: Arc::clone(&system.plan), places }
    }

    /// The slot of that name.
    #[must_use]
    pub fn entry(&self, name: &str) -> Option<&Entry> {
        self.places.get(name).and_then(|place| self.entries.get(*place))
    }

    /// What sends values, or plain events, at the port of that name: a slot's, or a voter's.
    #[must_use]
    pub fn output(&self, slot: &str, port: &str) -> Option<Arc<OutPort>> {
        let own = self.entry(slot).and_then(|entry| entry.slot.writer(port));
        own.cloned().or_else(|| self.helpers.output(&PortRef { slot: slot.to_owned(), port: port.to_owned() }).cloned())
    }

    /// What the profiles say of a slot.
    #[must_use]
    pub fn plan_of(&self, entry: &Entry) -> Option<&SlotPlan> {
        self.plan.slots.get(entry.plan)
    }

    /// What composites there are, by name.
    #[must_use]
    pub fn composites(&self) -> &[CompositePlan] {
        &self.plan.composites
    }

    /// Why there is no slot of that name, with the way out; `besides`: what else would be taken.
    #[must_use]
    pub fn missing(&self, name: &str, besides: Besides) -> String {
        if self.helpers.named().any(|(voter, _)| voter == name) {
            return format!("`{name}` is a voter and no slot: `component info {name}` tells of it");
        }
        if let Some(composite) = self.composites().iter().find(|composite| composite.name == name) {
            let inside = composite.slots.iter().map(|slot| format!("`{slot}`")).collect::<Vec<_>>();
            let inside = suggest::listed(inside.iter().map(String::as_str));
            return format!("`{name}` is a composite and no slot; its slots are {inside}");
        }
        let composites = self.composites().iter().filter(|_| besides == Besides::All);
        let voters = self.helpers.named().filter(|_| besides != Besides::Nothing).map(|(name, _)| name);
        let slots = self.entries.iter().map(|entry| entry.slot.name);
        let known: Vec<&str> = slots.chain(composites.map(|composite| composite.name.as_str())).chain(voters).collect();
        let hint = suggest::hint(name, &known, |name| format!("`{name}`"));
        format!("there is no slot `{name}`; {}", hint.unwrap_or_else(|| "there are none".to_owned()))
    }

    /// Why a voter or a composite has no port of that name; `None`: it is neither.
    #[must_use]
    pub fn missing_port(&self, slot: &str, port: &str) -> Option<String> {
        let voter = self.helpers.named().find(|(name, _)| *name == slot);
        let voter = voter.map(|(_, voter)| ("voter", vec![voter.plan.port.as_str()]));
        let shown = |composite: &'_ CompositePlan| composite.name == slot;
        let (kind, known) = voter.or_else(|| {
            let composite = self.composites().iter().find(|composite| shown(composite))?;
            Some(("composite", composite.exports.iter().map(|(name, _)| name.as_str()).collect()))
        })?;
        let hint = suggest::hint(port, &known, |name| format!("`{slot}.{name}`"));
        Some(format!("{kind} `{slot}` has no port `{port}`; {}", hint.unwrap_or_else(|| "it shows none".to_owned())))
    }
}

/// What bears a name as slots do, and is taken as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Besides {
    /// Only slots have lives of their own.
    Nothing,
    /// Voters have faults, too.
    Voters,
    /// Voters and composites are looked at as well.
    All,
}

fn port_names(slot: &Slot) -> Vec<&str> {
    let data = slot.inputs.iter().map(|port| &port.name).chain(slot.outputs.iter().map(|port| &port.name));
    let services = slot.requestors.iter().map(|port| &port.name).chain(slot.providers.iter().map(|port| &port.name));
    let events = slot.events.names();
    data.chain(services).map(String::as_str).chain(events).collect()
}

/// Why the slot has no port of that name, with the way out.
#[must_use]
pub fn missing_port(slot: &Slot, name: &str) -> String {
    let known = port_names(slot);
    let slot = slot.name;
    let hint = suggest::hint(name, &known, |name| format!("`{slot}.{name}`"));
    format!("slot `{slot}` has no port `{name}`; {}", hint.unwrap_or_else(|| "it has no ports".to_owned()))
}

impl Entry {
    /// Why the slot has no port of that name, with the way out.
    #[must_use]
    pub fn missing(&self, name: &str) -> String {
        missing_port(&self.slot, name)
    }
}

/// Who is connected with whom, at one moment.
pub struct Wires(HashMap<usize, Vec<End>>);

impl Wires {
    /// The other ends of a port's connections.
    #[must_use]
    pub fn of<P>(&self, port: &Arc<P>) -> &[End] {
        self.0.get(&address(Arc::as_ptr(port))).map(Vec::as_slice).unwrap_or_default()
    }

    fn join(&mut self, (one, one_end): (usize, &End), (other, other_end): (usize, &End)) {
        self.0.entry(one).or_default().push(other_end.clone());
        self.0.entry(other).or_default().push(one_end.clone());
    }
}

fn address<P>(port: *const P) -> usize {
    port.addr()
}

impl Directory {
    /// The slots, and what the fault manager's ports belong to.
    pub fn slots(&self) -> impl Iterator<Item = &Arc<Slot>> {
        self.entries.iter().map(|entry| &entry.slot).chain([ports::shared().slot()])
    }

    /// Who is connected with whom now: connections change at run time. No port is dropped by looking: the slots of both ends
    /// are held here.
    #[must_use]
    pub fn wires(&self) -> Wires {
        let mut wires = Wires(HashMap::new());
        let mut served: HashMap<usize, End> = HashMap::new();
        for slot in self.slots() {
            let end = |port: &str| End { slot: slot.name, port: port.to_owned() };
            served.extend(slot.inputs.iter().map(|port| (address(Arc::as_ptr(port)), end(&port.name))));
            served.extend(slot.providers.iter().map(|port| (address(Arc::as_ptr(port)), end(&port.name))));
            let events = &slot.events;
            served.extend(events.inputs.iter().map(|input| (address(Arc::as_ptr(&input.port)), end(&input.port.name))));
            served.extend(events.servers.iter().map(|port| (address(Arc::as_ptr(port)), end(&port.name))));
        }
        for slot in self.slots() {
            let own = |port: &str| End { slot: slot.name, port: port.to_owned() };
            join_outputs(slot.outputs.iter().chain(&slot.events.outputs), slot.name, &served, &mut wires);
            let asking =
                slot.requestors.iter().map(|port| (address(Arc::as_ptr(port)), &port.name, address(port.peer())));
            let clients = slot.events.clients.iter();
            let told = clients.map(|port| (address(Arc::as_ptr(port)), &port.name, address(port.peer())));
            for (client, name, target) in asking.chain(told) {
                if let Some(end) = served.get(&target) {
                    wires.join((client, &own(name)), (target, end));
                }
            }
        }
        for (name, voter) in self.helpers.named() {
            join_outputs(std::iter::once(&voter.helper.parts().output), name, &served, &mut wires);
        }
        wires
    }
}

fn join_outputs<'a>(
    outputs: impl Iterator<Item = &'a Arc<OutPort>>,
    slot: &'static str,
    served: &HashMap<usize, End>,
    wires: &mut Wires,
) {
    for port in outputs {
        let own = End { slot, port: port.name.clone() };
        for target in port.links().iter().map(|link| address(Arc::as_ptr(&link.target))) {
            if let Some(end) = served.get(&target) {
                wires.join((address(Arc::as_ptr(port)), &own), (target, end));
            }
        }
    }
}

/// What the daemon is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// It boots.
    Starting,
    /// It runs.
    Running,
    /// It reads its profiles again.
    Reloading,
}

impl Phase {
    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Reloading => "reloading",
        }
    }
}

/// The newest directory, for whoever looks.
#[derive(Default)]
pub struct Board {
    // Held to clone or swap a pointer.
    newest: Mutex<Option<Arc<Directory>>>,
    phase: AtomicU8,
}

impl Board {
    /// The newest; nothing runs yet where there is none.
    #[must_use]
    pub fn newest(&self) -> Option<Arc<Directory>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What the daemon is at.
    #[must_use]
    pub fn phase(&self) -> Phase {
        match self.phase.load(Ordering::Relaxed) {
            0 => Phase::Starting,
            1 => Phase::Running,
            _ => Phase::Reloading,
        }
    }

    /// Says what the daemon is at.
    pub fn set_phase(&self, phase: Phase) {
        self.phase.store(phase as u8, Ordering::Relaxed);
    }

    fn swap(&self, next: Option<Arc<Directory>>) -> Option<Arc<Directory>> {
        std::mem::replace(&mut *self.newest.lock().unwrap_or_else(PoisonError::into_inner), next)
    }
}

/// A look takes microseconds; longer only where the control thread finds no processor.
const RETIREMENT: Duration = Duration::from_millis(50);

/// The main loop's side: puts directories up and takes them down.
#[derive(Default)]
pub struct Publisher {
    board: Arc<Board>,
    retired: Vec<Arc<Directory>>,
}

impl Publisher {
    /// Where the directories are put up.
    #[must_use]
    pub fn board(&self) -> Arc<Board> {
        Arc::clone(&self.board)
    }

    /// Puts up what runs now.
    pub fn publish(&mut self, system: &System) {
        self.replace(Some(Arc::new(Directory::of(system))));
        self.board.set_phase(Phase::Running);
    }

    /// Takes the last one down.
    pub fn withdraw(&mut self) {
        self.replace(None);
    }

    fn replace(&mut self, next: Option<Arc<Directory>>) {
        self.retired.extend(self.board.swap(next));
        let began = Instant::now();
        while !self.drop_unused() && began.elapsed() < RETIREMENT {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Nobody can get hold of a retired one again: who is the only holder now stays it.
    fn drop_unused(&mut self) -> bool {
        self.retired.retain(|directory| Arc::strong_count(directory) > 1);
        self.retired.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_directory_that_is_looked_at_is_kept_and_dropped_by_its_publisher() {
        let plan = Plan {
            root: std::path::PathBuf::new(),
            system: crate::profile::plan::SystemPlan::default(),
            applications: Vec::new(),
            slots: Vec::new(),
            connections: Vec::new(),
            composites: Vec::new(),
            dependencies: Vec::new(),
            order: Vec::new(),
            monitors: Vec::new(),
            reference_models: Vec::new(),
            votings: Vec::new(),
        };
        let helpers = Helpers::default();
        let directory = Directory { entries: Vec::new(), helpers, plan: Arc::new(plan), places: HashMap::new() };
        let (mut publisher, directory) = (Publisher::default(), Arc::new(directory));
        publisher.replace(Some(directory));
        let held = publisher.board().newest();
        assert!(held.is_some());
        publisher.withdraw();
        assert!(publisher.board().newest().is_none());
        assert_eq!(publisher.retired.len(), 1);
        drop(held);
        publisher.withdraw();
        assert!(publisher.retired.is_empty());
    }
}
