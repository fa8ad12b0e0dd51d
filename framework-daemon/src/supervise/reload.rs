//! New plan, difference, prepare, commit; or nothing at all.
//!
//! Prepare may fail and touches nothing that runs: new plugins are loaded, new instances created and initialised beside
//! the old ones, new links built. Commit cannot fail: old slots stop, links are swapped, new slots start. Slots that did
//! not change are not even asked.

use std::path::PathBuf;
use std::sync::Arc;

use super::blueprint::{self, Blueprint};
use super::boot;
use super::helpers::{self, Helpers};
use super::monitors::{self, Monitors};
use super::services;
use super::system::{Placed, System};
use super::wiring::{self, Wiring};
use crate::model::limits::SHUTDOWN_STEP as STEP;
use crate::profile::diff::diff;
use crate::profile::plan::{Plan, SlotPlan};

/// What a reload did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    /// Slots that are new.
    pub added: Vec<String>,
    /// Slots that are gone.
    pub removed: Vec<String>,
    /// Slots that were built anew.
    pub changed: Vec<String>,
    /// Slots that were not touched.
    pub kept: usize,
    /// Those of the changed ones that go on from their checkpoint.
    pub taken_up: Vec<String>,
}

impl std::fmt::Display for Changes {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { added, changed, removed, kept, taken_up } = self;
        let names = |names: &[String]| names.join(", ");
        write!(
            formatter,
            "reloaded: added [{}], changed [{}], removed [{}], {kept} not touched",
            names(added),
            names(changed),
            names(removed)
        )?;
        if taken_up.is_empty() {
            return Ok(());
        }
        write!(formatter, ", going on from checkpoints [{}]", names(taken_up))
    }
}

/// Brings a running system to a new plan.
///
/// # Errors
/// All that is wrong; the system runs on as it was.
pub fn reload(system: &mut System, plan: &Arc<Plan>, extra: &[PathBuf]) -> Result<Changes, Vec<String>> {
    let (changes, fresh) = compare(system, plan);
    let catalogue = system.catalogue.in_directories(boot::directories(plan, extra));
    let blueprints = blueprint::draw(&fresh, &catalogue)?;
    let old_plan = std::mem::replace(&mut system.plan, Arc::clone(plan));
    match prepare(system, blueprints, &old_plan, plan, &changes) {
        Ok(prepared) => {
            system.catalogue = catalogue;
            let taken_up = commit(system, prepared, &changes);
            Ok(Changes { taken_up, ..changes })
        }
        Err(reasons) => {
            system.plan = old_plan;
            drop_unused_executors(system);
            Err(reasons)
        }
    }
}

/// What changes, and the plans of all slots that must be built. A slot whose executor changed is built anew: a thread
/// keeps its schedule for life. So is one whose plugin was built anew.
fn compare(system: &System, plan: &Plan) -> (Changes, Vec<SlotPlan>) {
    let diff = diff(&system.plan, plan);
    let moved = |slot: &&SlotPlan| slot.executor.as_ref().is_some_and(|name| diff.executors_changed.contains(name));
    let is_new = |slot: &SlotPlan| diff.slots_added.contains(&slot.name);
    let rebuilt = |slot: &SlotPlan| {
        let placed = system.slot(&slot.name);
        placed.is_some_and(|placed| placed.plugins.iter().any(|plugin| plugin.is_outdated()))
    };
    let is_changed =
        |slot: &SlotPlan| !is_new(slot) && (diff.slots_changed.contains(&slot.name) || moved(&slot) || rebuilt(slot));
    let fresh: Vec<SlotPlan> = plan.slots.iter().filter(|slot| is_new(slot) || is_changed(slot)).cloned().collect();
    let changed = fresh.iter().filter(|slot| is_changed(slot)).map(|slot| slot.name.clone()).collect();
    let kept = plan.slots.len() - fresh.len();
    let (added, removed) = (diff.slots_added.clone(), diff.slots_removed.clone());
    (Changes { added, removed, changed, kept, taken_up: Vec::new() }, fresh)
}

/// What a commit puts in place.
struct Prepared {
    slots: Vec<Placed>,
    wiring: Wiring,
    helpers: Helpers,
    monitors: Monitors,
}

/// Creates and initialises what is new and builds the new links. Undoes itself when it fails.
fn prepare(
    system: &mut System,
    blueprints: Vec<Blueprint<'_>>,
    old_plan: &Plan,
    plan: &Plan,
    changes: &Changes,
) -> Result<Prepared, Vec<String>> {
    let mut placed = Vec::new();
    let result = blueprints.into_iter().try_for_each(|blueprint| {
        placed.push(boot::place(system, blueprint)?);
        Ok(())
    });
    let slots = assemble(system, &placed, plan, changes);
    let build = || {
        let helpers = helpers::build(&system.helpers, plan, &slots, &system.faults)?;
        let wiring = wiring::build(&old_plan.connections, &plan.connections, &slots, &helpers)?;
        let monitors = monitors::build(&system.monitors, plan, &slots, &helpers)?;
        Ok((wiring, helpers, monitors))
    };
    let built = result.map_err(|reason: String| vec![reason]).and_then(|()| build());
    match built {
        Ok((wiring, helpers, monitors)) => Ok(Prepared { slots, wiring, helpers, monitors }),
        Err(reasons) => {
            for new in placed {
                let _ = new.executor.remove(new.member, STEP);
            }
            Err(reasons)
        }
    }
}

/// The slots of the new plan, in its order: kept ones as they are, the others new.
fn assemble(system: &System, placed: &[Placed], plan: &Plan, changes: &Changes) -> Vec<Placed> {
    let kept = |name: &str| {
        let gone = changes.changed.iter().any(|changed| changed == name);
        system.slot(name).filter(|_| !gone).cloned()
    };
    let new = |name: &str| placed.iter().find(|new| new.slot.name == name).cloned();
    plan.slots.iter().filter_map(|slot| new(&slot.name).or_else(|| kept(&slot.name))).collect()
}

/// Returns the slots that go on from their checkpoint.
fn commit(system: &mut System, prepared: Prepared, changes: &Changes) -> Vec<String> {
    let Prepared { slots, wiring, helpers, monitors } = prepared;
    let leaves = |placed: &&Placed| {
        let name = placed.slot.name;
        changes.removed.iter().chain(&changes.changed).any(|gone| gone == name)
    };
    let leaving: Vec<Placed> = system.slots.iter().rev().filter(leaves).cloned().collect();
    services::replace_providers(&leaving);
    leaving.iter().for_each(|placed| placed.slot.events.replace());
    let taken_up = inherit(&leaving, &slots);
    for old in &leaving {
        warn_if_stuck(old, old.executor.stop_member(old.member, STEP).is_err());
    }
    wiring::announce(&system.registry, &slots, &helpers, &system.plan.composites);
    wiring::disconnect(&leaving);
    wiring::apply(&wiring, &slots);
    helpers::apply(&helpers, &slots);
    system.follow(monitors, &helpers);
    for old in &leaving {
        warn_if_stuck(old, old.executor.remove(old.member, STEP).is_err());
    }
    boot::rank(&slots, &helpers::flow(&system.plan));
    (system.slots, system.helpers) = (slots, helpers);
    let is_new = |slot: &str| changes.added.iter().chain(&changes.changed).any(|name| name == slot);
    if let Err(reason) = boot::start(&system.plan, &system.slots, &system.helpers, is_new) {
        tracing::error!("{reason}");
    }
    system.helpers.expect();
    drop(leaving);
    drop_unused_executors(system);
    taken_up
}

/// Those that take the place of others go on from their checkpoints, where they have the same regions; returns them.
fn inherit(leaving: &[Placed], slots: &[Placed]) -> Vec<String> {
    let mut taken_up = Vec::new();
    for old in leaving {
        let Some(new) = slots.iter().find(|new| new.slot.name == old.slot.name) else { continue };
        // One that is stuck has nothing to hand over; that is told when it is to stop.
        let Some(kept) = old.executor.hand_over(old.member, STEP).ok().flatten() else { continue };
        match new.executor.inherit(new.member, kept, STEP) {
            Ok(()) => taken_up.push(new.slot.name.to_owned()),
            Err(reason) => {
                tracing::warn!("slot {}: built anew, it does not go on from its checkpoint: {reason}", new.slot.name);
            }
        }
    }
    taken_up
}

fn warn_if_stuck(placed: &Placed, stuck: bool) {
    if stuck {
        tracing::error!("slot {}: it does not return: left behind", placed.slot.name);
    }
}

fn drop_unused_executors(system: &mut System) {
    let slots = &system.slots;
    system.executors.retain(|_, executor| slots.iter().any(|placed| Arc::ptr_eq(&placed.executor, executor)));
}
