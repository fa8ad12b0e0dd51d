//! What the control socket looks at: the slots that run, with their ports and connections, as they were at the last boot or
//! reload. Counters and states in it are live.
//!
//! The last holder of a slot frees values that plugins made, by code of theirs; so that this is never the control thread, the
//! main loop keeps every directory that it replaced until nobody else holds it.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::exec::slot::Slot;
use crate::exec::workshop::Shelf;
use crate::port::input::InPort;
use crate::profile::plan::{Plan, SlotPlan};
use crate::profile::suggest;
use crate::supervise::system::System;

/// All that runs.
pub struct Directory {
    /// Slots in the order in which they were started.
    pub entries: Vec<Entry>,
    plan: Arc<Plan>,
    places: HashMap<&'static str, usize>,
}

/// A slot with what is not in it.
pub struct Entry {
    /// The slot.
    pub slot: Arc<Slot>,
    /// Its spares.
    pub shelf: Arc<Shelf>,
    /// For each input, who writes to it.
    pub writers: Vec<Vec<End>>,
    /// For each output, who reads it.
    pub readers: Vec<Vec<End>>,
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
    /// Of what runs now. Only for the thread that may drop slots: it looks at connections.
    #[must_use]
    pub fn of(system: &System) -> Self {
        let plans: HashMap<&str, usize> =
            system.plan.slots.iter().enumerate().map(|(place, plan)| (plan.name.as_str(), place)).collect();
        let entry = |placed: &crate::supervise::system::Placed| {
            let plan = *plans.get(placed.slot.name)?;
            let (slot, shelf) = (Arc::clone(&placed.slot), Arc::clone(&placed.shelf));
            let (writers, readers) = (vec![Vec::new(); slot.inputs.len()], vec![Vec::new(); slot.outputs.len()]);
            Some(Entry { slot, shelf, writers, readers, plan })
        };
        let mut entries: Vec<Entry> = system.slots.iter().filter_map(entry).collect();
        connect(&mut entries);
        let places = entries.iter().enumerate().map(|(place, entry)| (entry.slot.name, place)).collect();
        Self { entries, plan: Arc::clone(&system.plan), places }
    }

    /// The slot of that name.
    #[must_use]
    pub fn entry(&self, name: &str) -> Option<&Entry> {
        self.places.get(name).and_then(|place| self.entries.get(*place))
    }

    /// What the profiles say of a slot.
    #[must_use]
    pub fn plan_of(&self, entry: &Entry) -> Option<&SlotPlan> {
        self.plan.slots.get(entry.plan)
    }

    /// Why there is no slot of that name, with the way out.
    #[must_use]
    pub fn missing(&self, name: &str) -> String {
        let known: Vec<&str> = self.entries.iter().map(|entry| entry.slot.name).collect();
        let hint = suggest::hint(name, &known, |name| format!("`{name}`"));
        format!("there is no slot `{name}`; {}", hint.unwrap_or_else(|| "`component list` shows all".to_owned()))
    }
}

impl Entry {
    /// Why the slot has no port of that name, with the way out.
    #[must_use]
    pub fn missing(&self, name: &str) -> String {
        let inputs = self.slot.inputs.iter().map(|port| port.name.as_str());
        let known: Vec<&str> = inputs.chain(self.slot.outputs.iter().map(|port| port.name.as_str())).collect();
        let slot = self.slot.name;
        let hint = suggest::hint(name, &known, |name| format!("`{slot}.{name}`"));
        format!("slot `{slot}` has no port `{name}`; {}", hint.unwrap_or_else(|| "it has no ports".to_owned()))
    }
}

/// Fills in both sides of every connection.
fn connect(entries: &mut [Entry]) {
    let mut inputs: HashMap<*const InPort, (usize, usize)> = HashMap::new();
    for (place, entry) in entries.iter().enumerate() {
        inputs.extend(entry.slot.inputs.iter().enumerate().map(|(port, input)| (Arc::as_ptr(input), (place, port))));
    }
    let mut found = Vec::new();
    for (place, entry) in entries.iter().enumerate() {
        for (port, output) in entry.slot.outputs.iter().enumerate() {
            let targets = output.links().into_iter().filter_map(|link| inputs.get(&Arc::as_ptr(&link.target)).copied());
            found.extend(targets.map(|target| ((place, port), target)));
        }
    }
    for ((writer, output), (reader, input)) in found {
        let (from, to) = (&entries[writer].slot, &entries[reader].slot);
        let from = End { slot: from.name, port: from.outputs[output].name.clone() };
        let to = End { slot: to.name, port: to.inputs[input].name.clone() };
        entries[writer].readers[output].push(to);
        entries[reader].writers[input].push(from);
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
            dependencies: Vec::new(),
            order: Vec::new(),
            monitors: Vec::new(),
            reference_models: Vec::new(),
            votings: Vec::new(),
        };
        let directory = Directory { entries: Vec::new(), plan: Arc::new(plan), places: HashMap::new() };
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
