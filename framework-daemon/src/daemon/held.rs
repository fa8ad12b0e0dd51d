//! Whom a latch holds that the run before left: its actuators then, by whatever name they go now.
//!
//! Somebody may have renamed them meanwhile, and nobody can tell from the profiles which slot drives the wheel that was `left`.
//! So where a name of then is gone, the slots of its class take its place that had no name then; where there are none either,
//! every slot may be it, and all of them wait for the operator. Robots that wait for nothing are a nuisance; one that drives
//! although its emergency stop is latched is a danger.

use crate::profile::plan::{Plan, SlotPlan};
use crate::sys::latch::{Besides, Record};

/// Makes actuators of those that were; returns who is held although the profiles do not say so, and why.
pub(super) fn hold(plan: &mut Plan, record: &Record) -> Vec<Besides> {
    let found = besides(plan, record);
    let gone = record.actuators.iter().filter(|name| !is_slot(plan, name));
    gone.for_each(|name| tracing::warn!("{}", gone_in_words(name)));
    found.iter().for_each(|(held, _)| tracing::warn!("{}: {}: it stays stopped, too", held.slot, held.reason));
    // More than a profile may name: safe outputs of these are not written from elsewhere, but they do not run.
    plan.system.emergency.extend(found.iter().filter(|(_, is_sure)| *is_sure).map(|(held, _)| held.slot.clone()));
    found.into_iter().map(|(held, _)| held).collect()
}

/// Each with whether it is, as far as anybody can tell, an actuator of then.
fn besides(plan: &Plan, record: &Record) -> Vec<(Besides, bool)> {
    let mut all: Vec<(Besides, bool)> = Vec::new();
    let mut add = |slot: &str, reason: String, is_sure: bool| {
        let is_new =
            !plan.system.emergency.iter().any(|name| name == slot) && all.iter().all(|(held, _)| held.slot != slot);
        if is_new {
            all.push((Besides { slot: slot.to_owned(), reason }, is_sure));
        }
    };
    for name in record.actuators.iter().filter(|name| is_slot(plan, name)) {
        add(name, "it was an actuator when the emergency stop was raised".to_owned(), true);
    }
    let mut lost = Vec::new();
    for (index, name) in record.actuators.iter().enumerate().filter(|(_, name)| !is_slot(plan, name)) {
        let class = record.classes.get(index).map_or("", String::as_str);
        let successors: Vec<&SlotPlan> = plan.slots.iter().filter(|slot| may_be(slot, class, record)).collect();
        for slot in &successors {
            add(&slot.name, format!("{}; this one is of the same class, {class}", gone_in_words(name)), true);
        }
        if successors.is_empty() {
            lost.push(name);
        }
    }
    for (name, slot) in lost.first().into_iter().flat_map(|name| plan.slots.iter().map(move |slot| (name, slot))) {
        add(&slot.name, format!("{}; nobody knows which one it is now", gone_in_words(name)), false);
    }
    all
}

fn is_slot(plan: &Plan, name: &str) -> bool {
    plan.slots.iter().any(|slot| slot.name == name)
}

fn gone_in_words(name: &str) -> String {
    format!("{name} was an actuator when the emergency stop was raised, and is no slot of these profiles")
}

/// True of a slot that had another name then, or none, and can be of that class.
fn may_be(slot: &SlotPlan, class: &str, record: &Record) -> bool {
    let secondaries = slot.rules.secondaries.iter().map(|secondary| &secondary.component);
    let is_of_class = std::iter::once(&slot.component).chain(secondaries).any(|component| component.name == class);
    is_of_class && !record.actuators.contains(&slot.name)
}
