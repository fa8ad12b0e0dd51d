//! The set of live things: executors and slots by name, and the plan that they follow.

use std::collections::HashMap;
use std::sync::Arc;

use super::catalogue::Catalogue;
use super::helpers::Helpers;
use super::monitors::Monitors;
use super::watch::Watch;
use crate::exec::executor::Executor;
use crate::exec::keep::Keep;
use crate::exec::slot::Slot;
use crate::exec::workshop::{Shelf, Workshop};
use crate::model::fault::FaultSender;
use crate::plugin::Plugin;
use crate::port::registry::Registry;
use crate::profile::plan::Plan;
use crate::sys::bell::Signal;

/// A slot that runs somewhere.
#[derive(Clone)]
pub struct Placed {
    /// The slot.
    pub slot: Arc<Slot>,
    /// Its executor.
    pub executor: Arc<Executor>,
    /// Its number there.
    pub member: usize,
    /// Its spares.
    pub shelf: Arc<Shelf>,
    /// Rings for it.
    pub signal: Arc<Signal>,
    /// Whether it is started at boot.
    pub autostart: bool,
    /// The plugins of its classes, as far as they were loaded at boot.
    pub plugins: Vec<Arc<Plugin>>,
}

/// All that runs.
pub struct System {
    /// What it follows.
    pub plan: Arc<Plan>,
    /// Executors by name.
    pub executors: HashMap<String, Arc<Executor>>,
    /// Slots in the order in which they were started.
    pub slots: Vec<Placed>,
    /// Models and voters among them.
    pub helpers: Helpers,
    /// What watches their ports.
    pub monitors: Monitors,
    /// Who looks for silence at monitors and voters.
    pub watch: Option<Watch>,
    /// Their ports, for who wires at run time.
    pub registry: Arc<Registry>,
    /// Where plugins come from.
    pub catalogue: Catalogue,
    /// Where spares come from.
    pub workshop: Workshop,
    /// To the fault manager.
    pub faults: FaultSender,
    /// The file that checkpoints lie in; `None`: they end with the daemon.
    pub keep: Option<Arc<Keep>>,
}

impl System {
    /// Puts these monitors in the place of those before, and looks for silence at them and at these voters.
    pub fn follow(&mut self, mut monitors: Monitors, helpers: &Helpers) {
        // Its thread first: two that look at one port would tell twice.
        self.watch = None;
        monitors.follow(std::mem::take(&mut self.monitors));
        self.monitors = monitors;
        self.watch = Watch::start(self.monitors.looks().chain(helpers.looks()).collect()).unwrap_or_else(|error| {
            tracing::error!("monitors: no thread: silence at their ports, and of voters, is not noticed: {error}");
            None
        });
    }

    /// The slot of that name.
    #[must_use]
    pub fn slot(&self, name: &str) -> Option<&Placed> {
        self.slots.iter().find(|placed| placed.slot.name == name)
    }
}

/// Slots by name, for wiring.
#[must_use]
pub fn by_name(slots: &[Placed]) -> HashMap<&str, &Placed> {
    slots.iter().map(|placed| (placed.slot.name, placed)).collect()
}
