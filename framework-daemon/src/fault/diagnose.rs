//! Diagnosis beyond the slot: who may run, who is held and why, and of which fault another one is a consequence. Pure: no
//! clock, lock, log or thread; what the slots themselves did was answered on their executors by then.

use std::collections::VecDeque;

use super::graph::{Graph, Need, Number};
use crate::model::chain;
use crate::model::limits::{CHAIN_STEPS, CONSEQUENCE_WINDOW, RECENT_FAULTS};
use crate::model::symptom::Symptom;
use crate::model::time::nanoseconds;
use crate::profile::plan::Coverage;

/// How a slot, or a voter, is by itself, whatever others are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Own {
    /// It is to run, and can; or enough members of the voter agree.
    Wanted,
    /// Nobody started it, or it was told to stop.
    Off,
    /// The fault of that sequence number stopped it; or too few members of the voter agree, which that fault told.
    Faulty(u64),
}

/// What follows for a slot from all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// It runs.
    Runs,
    /// It does not run, and nobody wants it to.
    Off,
    /// A fault of its own stopped it.
    Faulty,
    /// It would run, but others keep it from that.
    Held(Reason),
}

/// Why a slot is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reason {
    /// What keeps it.
    pub why: Why,
    /// The fault that it comes of; `None`: of none, somebody was told to stop.
    pub root: Option<u64>,
}

/// What keeps a slot from running.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// Too few of those that it needs work: the need of that number among its own.
    Need(usize),
    /// The fault of that slot covers it.
    Covered(Number),
    /// The emergency stop is latched.
    Emergency,
}

impl Reason {
    /// In words: `needs 1 of camera_a camera_b`.
    #[must_use]
    pub fn text(&self, graph: &Graph, slot: Number) -> String {
        let name = |number: Number| graph.nodes().get(number).map_or("", |node| node.name.as_str());
        match self.why {
            Why::Need(index) => {
                let need = graph.nodes().get(slot).and_then(|node| node.needs.get(index));
                format!("needs {}", need.map_or("", |need| need.text.as_str()))
            }
            Why::Covered(by) => format!("covered by the fault of {}", name(by)),
            Why::Emergency => "emergency stop".to_owned(),
        }
    }
}

/// What follows for each slot from how each slot and voter is by itself; `emergency`: of which fault the emergency stop is latched.
#[must_use]
pub fn diagnose(graph: &Graph, own: &[Own], emergency: Option<Option<u64>>) -> Vec<Verdict> {
    let mut verdicts = vec![Verdict::Runs; graph.nodes().len()];
    let covers = covers(graph, own);
    for number in graph.order() {
        let by_others = || unmet(graph, &verdicts, own, *number);
        let held = |reason: Option<Reason>| reason.map_or(Verdict::Runs, Verdict::Held);
        // Slots and voters come first.
        let verdict = match own.get(*number) {
            None => held(by_others()),
            Some(Own::Off) => Verdict::Off,
            Some(Own::Faulty(_)) => Verdict::Faulty,
            Some(Own::Wanted) => {
                let stop = emergency.filter(|_| graph.nodes()[*number].waits_for_clear());
                let stop = stop.map(|root| Reason { why: Why::Emergency, root });
                held(stop.or_else(|| covered(graph, &covers, *number)).or_else(by_others))
            }
        };
        verdicts[*number] = verdict;
    }
    verdicts.truncate(graph.slots());
    verdicts
}

/// Slots whose fault-stop reaches further than themselves.
fn covers(graph: &Graph, own: &[Own]) -> Vec<(Number, u64)> {
    let nodes = own.iter().zip(graph.nodes()).enumerate();
    let faulty = nodes.filter(|(_, (_, node))| node.coverage != Coverage::Component);
    faulty
        .filter_map(|(number, (own, _))| if let Own::Faulty(root) = own { Some((number, *root)) } else { None })
        .collect()
}

fn covered(graph: &Graph, covers: &[(Number, u64)], number: Number) -> Option<Reason> {
    let nodes = graph.nodes();
    let reaches = |by: Number| nodes[by].coverage == Coverage::System || nodes[by].executor == nodes[number].executor;
    let (by, root) = covers.iter().find(|(by, _)| *by != number && reaches(*by))?;
    Some(Reason { why: Why::Covered(*by), root: Some(*root).filter(|root| *root != 0) })
}

/// The first need of a node that is not met, and the latest fault behind it.
fn unmet(graph: &Graph, verdicts: &[Verdict], own: &[Own], number: Number) -> Option<Reason> {
    let works = |needed: &&Number| verdicts[**needed] == Verdict::Runs;
    let is_unmet = |need: &Need| need.on.iter().filter(works).count() < need.require;
    let needs = &graph.nodes()[number].needs;
    let index = needs.iter().position(is_unmet)?;
    let root_of = |needed: &Number| match verdicts[*needed] {
        Verdict::Faulty => match own.get(*needed) {
            // Without a number where its event was lost.
            Some(Own::Faulty(root)) => Some(*root).filter(|root| *root != 0),
            _ => None,
        },
        Verdict::Held(reason) => reason.root,
        Verdict::Runs | Verdict::Off => None,
    };
    Some(Reason { why: Why::Need(index), root: needs[index].on.iter().filter_map(root_of).max() })
}

/// A fault of late.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Past {
    slot: Number,
    at_ns: u64,
    root: u64,
    /// By it a voter may lose the slot's vote.
    costs_vote: bool,
}

/// Faults of late: a bounded memory.
#[derive(Clone, Debug, Default)]
pub struct Recent(VecDeque<Past>);

impl Recent {
    /// Of which earlier fault that of `slot` is a consequence: one of the same chain, of what the slot needs or of who
    /// writes to it, within [`CONSEQUENCE_WINDOW`] before.
    #[must_use]
    pub fn root_of(&self, graph: &Graph, slot: Number, at_ns: u64) -> Option<u64> {
        let horizon = at_ns.saturating_sub(nanoseconds(CONSEQUENCE_WINDOW));
        let near: Vec<&Past> =
            self.0.iter().filter(|past| past.slot != slot && (horizon..=at_ns).contains(&past.at_ns)).collect();
        if near.is_empty() {
            return None;
        }
        // Nearest first: of two earlier faults the one that lies closer on the chain is the cause.
        let mut steps = graph.upstream(slot);
        steps.find_map(|step| near.iter().rev().find(|past| step.contains(&past.slot)).map(|past| past.root))
    }

    /// Of which earlier fault it is a consequence that a voter lost these members, each of which it heard last, and agreed with,
    /// at that time: one since then by which they may have lost their votes. Their own come before those of whom they
    /// need or hear, and of several the latest.
    #[must_use]
    pub fn root_of_loss(&self, graph: &Graph, voter: Number, lost: &[(Number, u64)], at_ns: u64) -> Option<u64> {
        let since_ns = lost.iter().map(|(_, since_ns)| *since_ns).min()?;
        let may_be = |past: &&Past| past.costs_vote && past.slot != voter && (since_ns..=at_ns).contains(&past.at_ns);
        let near: Vec<&Past> = self.0.iter().filter(may_be).collect();
        if near.is_empty() {
            return None;
        }
        let is_own = |past: &&&Past| lost.iter().any(|(slot, since_ns)| past.slot == *slot && past.at_ns >= *since_ns);
        let own = near.iter().rev().find(is_own).map(|past| past.root);
        let members: Vec<Number> = lost.iter().map(|(slot, _)| *slot).collect();
        let mut further = graph.upstream_of(&members).take(CHAIN_STEPS - 1);
        own.or_else(|| {
            further.find_map(|step| near.iter().rev().find(|past| step.contains(&past.slot)).map(|past| past.root))
        })
    }

    /// The root of the fault that a slot had at about that time; `None`: nothing is known of one yet.
    #[must_use]
    pub fn root_at(&self, slot: Number, at_ns: u64) -> Option<u64> {
        let is_it = |past: &&Past| past.slot == slot && past.at_ns.abs_diff(at_ns) <= nanoseconds(CONSEQUENCE_WINDOW);
        self.0.iter().rev().find(is_it).map(|past| past.root)
    }

    /// Remembers a fault; `root` is the fault that it is a consequence of, or its own sequence number.
    pub fn remember(&mut self, slot: Number, symptom: Symptom, at_ns: u64, root: u64) {
        if self.0.len() == RECENT_FAULTS {
            self.0.pop_front();
        }
        self.0.push_back(Past { slot, at_ns, root, costs_vote: chain::costs_vote(symptom) });
    }

    /// Forgets all: numbers of slots mean others from now on.
    pub fn forget(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::super::graph::Node;
    use super::*;

    #[test]
    fn a_voter_lost_its_member_by_what_befell_that_since_it_agreed() {
        let need = Need { on: vec![0, 1], require: 2, text: String::new() };
        let voter = Node { needs: vec![need], ..Node::default() };
        let nodes = vec![Node::default(), Node::default(), Node::default(), voter];
        // The third writes to the second.
        let graph = Graph::new(nodes, 3, 1, &[(2, 1)]);
        let mut recent = Recent::default();
        recent.remember(1, Symptom::CrashSegv, 50, 5);
        recent.remember(2, Symptom::Hang, 55, 6);
        recent.remember(0, Symptom::Overrun, 90, 7);
        let later = 10 * nanoseconds(CONSEQUENCE_WINDOW);
        let root = |lost: &[(Number, u64)]| recent.root_of_loss(&graph, 3, lost, later);
        assert_eq!((root(&[]), root(&[(0, 0)])), (None, None), "who is late has a vote");
        assert_eq!((root(&[(0, 40), (1, 40)]), root(&[(1, 50)])), (Some(5), Some(5)), "however long ago");
        assert_eq!((root(&[(1, 52)]), root(&[(1, 60)])), (Some(6), None), "what it was fed by, but nothing before");
    }
}
