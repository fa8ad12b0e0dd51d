//! Old plan, new plan: what a reload has to touch.
//!
//! Where something is written does not count: a comment added above a slot must not restart it. The parts are compared
//! as JSON without their locations, so that a field added to the plan later counts by itself; comparing field by field
//! was forgotten twice in a week.

use std::collections::{HashMap, HashSet};

use serde::Serialize;
use serde_json::Value;

use super::plan::{ConnectionPlan, ExecutorPlan, Plan, PortKind, PortRef, SlotPlan, SystemPlan};

/// What differs between two plans, by name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Diff {
    /// Slots that only the new plan has.
    pub slots_added: Vec<String>,
    /// Slots that only the old plan has.
    pub slots_removed: Vec<String>,
    /// Slots that differ in anything but their place in a file.
    pub slots_changed: Vec<String>,
    /// Connections that only the new plan has. One whose checks changed is removed and added.
    pub connections_added: Vec<Link>,
    /// Connections that only the old plan has.
    pub connections_removed: Vec<Link>,
    /// Executors that were added, removed or changed.
    pub executors_changed: Vec<String>,
    /// True where anything else changed: plugin directories, dependencies, helpers, emergency stop.
    pub system_changed: bool,
}

/// The ends of a connection.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize)]
pub struct Link {
    /// Its pattern.
    pub kind: PortKind,
    /// Output or required end.
    pub source: PortRef,
    /// Input or provided end.
    pub target: PortRef,
}

impl Diff {
    /// True where a reload has nothing to do.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// What changes from `old` to `new`.
#[must_use]
pub fn diff(old: &Plan, new: &Plan) -> Diff {
    let mut result = Diff::default();
    slots(&old.slots, &new.slots, &mut result);
    connections(&old.connections, &new.connections, &mut result);
    result.executors_changed = executors(&old.system.executors, &new.system.executors);
    result.system_changed = rest(old) != rest(new);
    result
}

fn slots(old: &[SlotPlan], new: &[SlotPlan], result: &mut Diff) {
    let by_name = |slots: &[SlotPlan]| -> HashMap<String, Value> {
        slots.iter().map(|slot| (slot.name.clone(), placeless(slot))).collect()
    };
    let (before, after) = (by_name(old), by_name(new));
    for slot in new {
        match before.get(&slot.name) {
            None => result.slots_added.push(slot.name.clone()),
            Some(was) if Some(was) != after.get(&slot.name) => result.slots_changed.push(slot.name.clone()),
            Some(_) => {}
        }
    }
    let gone = old.iter().filter(|slot| !after.contains_key(&slot.name));
    result.slots_removed = gone.map(|slot| slot.name.clone()).collect();
}

fn connections(old: &[ConnectionPlan], new: &[ConnectionPlan], result: &mut Diff) {
    let text = |connection: &ConnectionPlan| placeless(connection).to_string();
    let only_in = |these: &[ConnectionPlan], those: &[ConnectionPlan]| -> Vec<Link> {
        let others: HashSet<String> = those.iter().map(text).collect();
        these.iter().filter(|connection| !others.contains(&text(connection))).map(link).collect()
    };
    result.connections_added = only_in(new, old);
    result.connections_removed = only_in(old, new);
}

fn link(connection: &ConnectionPlan) -> Link {
    Link { kind: connection.kind, source: connection.source.clone(), target: connection.target.clone() }
}

fn executors(old: &[ExecutorPlan], new: &[ExecutorPlan]) -> Vec<String> {
    let differs = |one: &ExecutorPlan, others: &[ExecutorPlan]| {
        others.iter().find(|other| other.name == one.name).map(placeless) != Some(placeless(one))
    };
    let changed = new.iter().filter(|executor| differs(executor, old));
    let gone = old.iter().filter(|executor| new.iter().all(|other| other.name != executor.name));
    changed.chain(gone).map(|executor| executor.name.clone()).collect()
}

/// The plan without what is compared piece by piece; its root directory is no part of what it says.
fn rest(plan: &Plan) -> Value {
    let system = SystemPlan { executors: Vec::new(), ..plan.system.clone() };
    placeless(&Plan { root: Default::default(), system, slots: Vec::new(), connections: Vec::new(), ..plan.clone() })
}

/// A part of a plan as JSON without locations.
fn placeless(part: &impl Serialize) -> Value {
    // A plan has only string keys and finite numbers, so it always is JSON; null would compare as changed.
    let mut value = serde_json::to_value(part).unwrap_or_default();
    remove_locations(&mut value);
    value
}

fn remove_locations(value: &mut Value) {
    match value {
        Value::Object(object) => {
            object.remove("location");
            object.values_mut().for_each(remove_locations);
        }
        Value::Array(items) => items.iter_mut().for_each(remove_locations),
        _ => {}
    }
}
