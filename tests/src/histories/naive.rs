//! What must be, as a person would work it out: begin with all who are to run, and take out whoever may not until nobody is
//! taken out any more.

use framework_daemon::model::limits::{CHAIN_STEPS, CONSEQUENCE_WINDOW, RECENT_FAULTS};
use framework_daemon::model::symptom::{Severity, Symptom};
use framework_daemon::profile::plan::Coverage;

use super::drawn::Drawn;

/// How a slot is by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Own {
    Wanted,
    Off,
    Failed(u64),
}

/// Who runs when everything is settled; `short`: of which voters too few members agree.
pub(super) fn runs(drawn: &Drawn, own: &[Own], short: &[bool], is_latched: bool) -> Vec<bool> {
    let begins = |slot: usize| {
        own[slot] == Own::Wanted && !(is_latched && drawn.slots[slot].is_actuator) && !is_covered(drawn, own, slot)
    };
    let mut running: Vec<bool> = (0..own.len()).map(begins).collect();
    loop {
        let taken_out = (0..own.len()).find(|slot| running[*slot] && lacks(drawn, &running, short, *slot));
        match taken_out {
            Some(slot) => running[slot] = false,
            None => return running,
        }
    }
}

/// True where a slot lacks what it needs, when these run.
pub(super) fn lacks(drawn: &Drawn, running: &[bool], short: &[bool], slot: usize) -> bool {
    let works = |group: &[usize]| group.iter().all(|member| works(drawn, running, short, *member));
    let of_slots = drawn.needs.iter().filter(|need| need.slot == slot);
    let own = of_slots.map(|need| (need.on.iter().filter(|group| works(group)).count(), need.require));
    let application = drawn.slots[slot].application;
    let all_of = |application: usize| {
        let slots = drawn.slots.iter().enumerate();
        slots.filter(|(_, slot)| slot.application == application && slot.autostart).all(|(number, _)| running[number])
    };
    let of_applications = drawn.application_needs.iter().filter(|need| need.application == application);
    let others = of_applications.map(|need| (need.on.iter().filter(|other| all_of(**other)).count(), need.require));
    own.chain(others).any(|(count, require)| count < require)
}

/// True of a slot that runs, and of a voter that hands something on: so many of its members work, and agree.
fn works(drawn: &Drawn, running: &[bool], short: &[bool], number: usize) -> bool {
    let Some(place) = number.checked_sub(drawn.slots.len()) else { return running[number] };
    let voter = &drawn.voters[place];
    let working = voter.members.iter().filter(|member| works(drawn, running, short, **member)).count();
    !short[place] && working >= voter.require
}

fn is_covered(drawn: &Drawn, own: &[Own], slot: usize) -> bool {
    (0..own.len()).filter(|other| *other != slot && matches!(own[*other], Own::Failed(_))).any(|other| {
        match drawn.slots[other].coverage {
            Coverage::Component => false,
            Coverage::Executor => drawn.slots[other].executor == drawn.slots[slot].executor,
            Coverage::System => true,
        }
    })
}

/// A fault that was journaled.
#[derive(Clone, Copy)]
pub(super) struct Past {
    pub(super) slot: usize,
    pub(super) at_ns: u64,
    pub(super) root: u64,
}

/// Of which fault that of a slot is a consequence: the nearest on the chain, of several the latest.
pub(super) fn root_of(drawn: &Drawn, past: &[Past], slot: usize, at_ns: u64) -> Option<u64> {
    let remembered = &past[past.len().saturating_sub(RECENT_FAULTS)..];
    let window_ns = CONSEQUENCE_WINDOW.as_nanos() as u64;
    // Beyond a voter nobody looks: where it failed by itself that has a root of its own.
    let distances = distances(drawn, slot, &|_| false);
    let recent = remembered.iter().filter(|past| past.slot != slot && at_ns - past.at_ns <= window_ns);
    let mut nearest: Option<(usize, u64)> = None;
    for past in recent {
        let Some(distance) = distances[past.slot] else { continue };
        if nearest.is_none_or(|(other, _)| distance <= other) {
            nearest = Some((distance, past.root));
        }
    }
    nearest.map(|(_, root)| root)
}

/// True where a fault is left to that of another slot: one up the chain that was answered of late. `roots`: when each slot
/// was answered; `lapses`: when too few members of each voter agreed, which hides them otherwise. An empty slot and the emergency wait for nobody.
pub(super) fn is_left(
    drawn: &Drawn,
    roots: &[Vec<u64>],
    lapses: &[Vec<(u64, Option<u64>)>],
    slot: usize,
    symptom: Symptom,
    now_ns: u64,
) -> bool {
    let rules = &drawn.slots[slot];
    let ends_all = rules.coverage == Coverage::System;
    let may_wait = match rules.severity.get(symptom) {
        Severity::Reset => true,
        Severity::Stop => !ends_all,
        Severity::Ignore | Severity::Emergency => false,
    };
    if symptom == Symptom::CrashSegv || !may_wait {
        return false;
    }
    let window_ns = CONSEQUENCE_WINDOW.as_nanos() as u64;
    let is_late = |until_ns: Option<u64>| until_ns.is_some_and(|until_ns| until_ns + window_ns < now_ns);
    let hides =
        |voter: usize| !lapses[voter].iter().any(|(since_ns, until_ns)| *since_ns <= now_ns && !is_late(*until_ns));
    let distances = distances(drawn, slot, &|voter| !hides(voter));
    let others = (0..roots.len()).filter(|other| *other != slot && distances[*other].is_some());
    others.flat_map(|other| roots[other].iter().copied()).any(|at_ns| at_ns < now_ns && now_ns <= at_ns + window_ns)
}

/// How many steps up the chain every slot and voter is from one; groups, applications and what they stand at cost steps as the
/// graph's nodes do. `shows`: what lies beyond that voter counts.
fn distances(drawn: &Drawn, from: usize, shows: &dyn Fn(usize) -> bool) -> Vec<Option<usize>> {
    let slots = drawn.slots.len();
    let mut found: Vec<Option<usize>> = vec![None; slots + drawn.voters.len()];
    found[from] = Some(0);
    // As often as there are slots, and each edge each time (Bellman and Ford): slow, and right.
    for _ in 0..found.len() * 2 {
        for (down, up, steps) in edges(drawn) {
            if down >= slots && down != from && !shows(down - slots) {
                continue;
            }
            if let Some(distance) = found[down].map(|distance| distance + steps)
                && distance <= CHAIN_STEPS
                && found[up].is_none_or(|known| distance < known)
            {
                found[up] = Some(distance);
            }
        }
    }
    found
}

/// From who shows a fault to who may have caused it, and in how many steps.
fn edges(drawn: &Drawn) -> Vec<(usize, usize, usize)> {
    let mut edges: Vec<(usize, usize, usize)> =
        drawn.links.iter().map(|(writer, reader)| (*reader, *writer, 1)).collect();
    for (place, voter) in drawn.voters.iter().enumerate() {
        edges.extend(voter.members.iter().map(|member| (drawn.slots.len() + place, *member, 1)));
    }
    for need in &drawn.needs {
        for group in &need.on {
            let steps = if group.len() == 1 { 1 } else { 2 };
            edges.extend(group.iter().map(|member| (need.slot, *member, steps)));
        }
    }
    for need in &drawn.application_needs {
        let of = |application: usize| {
            let slots = drawn.slots.iter().enumerate();
            slots.filter(move |(_, slot)| slot.application == application)
        };
        for (slot, _) in of(need.application) {
            let others = need.on.iter().flat_map(|other| of(*other)).filter(|(_, other)| other.autostart);
            edges.extend(others.map(|(other, _)| (slot, other, 3)));
        }
    }
    edges
}
