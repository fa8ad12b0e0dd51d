//! Faults to provoke: in a slot, or in the daemon itself.

use std::time::Duration;

use component_sdk::abi::inject;

use crate::model::limits::BOOT_STEP;
use crate::model::time::nanoseconds;
use crate::profile::plan::{Plan, SlotPlan};
use crate::supervise::system::System;
use crate::sys::last_words;

/// A fault to provoke.
#[derive(Clone, Debug, PartialEq)]
pub struct Injection {
    /// In which slot; [`DAEMON`] is the daemon itself, where no slot bears that name.
    pub slot: String,
    /// Which one; a number of `component_sdk::abi::inject`.
    pub code: u8,
    /// How long after `ready`.
    pub after: Duration,
}

/// In place of a slot: a fault in the daemon's own code, to prove its last words.
pub const DAEMON: &str = "daemon";

/// What can be provoked in the daemon itself, and how.
const OWN_FAULTS: [(&str, fn()); 3] = [
    ("crash.segv", last_words::trap),
    ("crash.abort", || std::process::abort()),
    ("crash.panic", || panic!("injected panic of the daemon")),
];

/// What is wrong with them, one text each.
#[must_use]
pub fn check(injections: &[Injection], plan: &Plan) -> Vec<String> {
    let unknown = injections.iter().filter(|injection| plan.slots.iter().all(|slot| slot.name != injection.slot));
    let known: Vec<_> = plan.slots.iter().map(|slot| slot.name.as_str()).collect();
    let wrong = |injection: &Injection| match injection.slot.as_str() {
        DAEMON if own_fault(injection.code).is_some() => None,
        DAEMON => {
            let known = OWN_FAULTS.map(|(symptom, _)| symptom).join(", ");
            Some(format!("--inject: in the daemon itself only these can be provoked: {known}"))
        }
        slot => Some(format!("--inject: there is no slot `{slot}`; there are: {}", known.join(", "))),
    };
    let vain = injections.iter().filter_map(|injection| in_vain(injection, plan));
    unknown.filter_map(wrong).chain(vain).collect()
}

/// Why nothing would be found of it.
fn in_vain(Injection { slot, code, .. }: &Injection, plan: &Plan) -> Option<String> {
    let slot = plan.slots.iter().find(|planned| planned.name == *slot).filter(|_| *code == inject::OVERRUN)?;
    let name = &slot.name;
    match slot.component.execution.deadline {
        None => Some(format!("--inject: {name} has no <deadline>: no overrun would be found")),
        Some(_) => late(slot).is_none().then(|| format!("--inject: the <deadline> of {name} is too long to be missed")),
    }
}

/// The number of a callback that returns behind the slot's deadline.
fn late(slot: &SlotPlan) -> Option<u8> {
    slot.component.execution.deadline.and_then(|deadline| inject::burn(nanoseconds(deadline.budget)))
}

/// Last first, so that the next is popped.
#[must_use]
pub fn sorted(injections: &[Injection]) -> Vec<Injection> {
    let mut sorted = injections.to_vec();
    sorted.sort_by_key(|injection| std::cmp::Reverse(injection.after));
    sorted
}

/// Provokes one.
pub fn provoke(injection: &Injection, system: &System) {
    let Injection { slot, code, .. } = injection;
    let Some(placed) = system.slot(slot) else {
        if let Some(strike) = own_fault(*code).filter(|_| slot == DAEMON) {
            strike();
        }
        tracing::warn!("no fault was provoked in slot {slot}: it is gone");
        return;
    };
    let planned = system.plan.slots.iter().find(|planned| planned.name == *slot);
    let late = planned.filter(|_| *code == inject::OVERRUN).and_then(late);
    match placed.executor.inject(placed.member, late.unwrap_or(*code), BOOT_STEP) {
        Ok(true) => tracing::info!("fault {code} will be provoked in slot {slot}"),
        Ok(false) => tracing::warn!("no fault was provoked in slot {slot}: it is not running"),
        Err(stuck) => tracing::error!("no fault was provoked in slot {slot}: {stuck}"),
    }
}

fn own_fault(code: u8) -> Option<fn()> {
    OWN_FAULTS.iter().find(|(symptom, _)| inject::code(symptom) == Some(code)).map(|(_, strike)| *strike)
}
