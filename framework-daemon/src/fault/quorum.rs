//! What follows from a voter's own fault: too few of its members agree, so that it hands nothing on.
//!
//! A voter has no executor that would answer it, and no instance that could be reset. The emergency stop it raised itself; here
//! those that depend on it are stopped, and return when enough agree again. While a voter whose rule is the emergency stop
//! falls short, that is not taken back: whoever looks sees to its members first, and for that these may be started and reset
//! although it is latched. Unless too few of them can work at all without the actuators: then it is taken back, and the
//! voter's members have the time again in which each may be silent.

use std::sync::Arc;

use super::diagnose::Own;
use super::graph::{Graph, Number};
use super::handle::{Cast, Handler, Line};
use super::order::Refused;
use crate::exec::emergency;
use crate::model::fault::{Evidence, FaultEvent, Stage};
use crate::model::symptom::Severity;
use crate::port::voter::{Parts, Voter};
use crate::sys::clock;

/// True of a fault of a voter's own.
pub(super) const fn is_its_own(event: &FaultEvent) -> bool {
    matches!(event.fault.evidence, Evidence::Quorum { .. })
}

const fn stops_others(severity: Severity) -> bool {
    matches!(severity, Severity::Stop | Severity::Emergency)
}

/// How a voter is by itself; `before`: how it was when it was looked at last.
pub(super) fn own_of(voter: &Voter, before: Option<Own>) -> Own {
    match before {
        _ if !(stops_others(voter.parts().severity) && voter.falls_short()) => Own::Wanted,
        Some(own @ Own::Faulty(_)) => own,
        _ => Own::Faulty(0),
    }
}

impl Handler {
    /// Takes note of a voter's own fault, or its end, that was journaled under that sequence number; returns lines about what
    /// follows.
    pub(super) fn take_quorum(&mut self, event: &FaultEvent, sequence: u64, root: Option<u64>) -> Vec<Line> {
        let fault = (event.fault.stage == Stage::Confirmed).then(|| root.unwrap_or(sequence));
        self.note_emergency(event, sequence);
        let Some(cast) = &self.cast else {
            // Nothing is handled at this moment: the voter will tell how it is, and by which fault only this does.
            self.before
                .extend(fault.filter(|_| stops_others(event.severity)).map(|root| (event.slot, Own::Faulty(root))));
            return Vec::new();
        };
        let Some(voter) = cast.graph.voter(event.slot) else { return Vec::new() };
        if let Some(root) = fault {
            self.recent.remember(voter, event.fault.at_ns, root);
        }
        if !stops_others(event.severity) {
            return Vec::new();
        }
        self.situation.vote(voter, fault);
        self.settle()
    }

    /// Events were lost: the voters tell what they said.
    pub(super) fn look_at_voters(&mut self) {
        for (number, voter) in self.cast.iter().flat_map(Cast::numbered) {
            match own_of(voter, Some(self.situation.own(number))) {
                Own::Faulty(root) => self.situation.vote(number, Some(root)),
                _ => self.situation.vote(number, None),
            }
        }
    }

    /// True of a slot that may be started or reset although the emergency stop is latched: a voter waits for what it says.
    pub(super) fn is_missed(&self, cast: &Cast, slot: Number) -> bool {
        let mut voters = cast.short_voters();
        !cast.graph.nodes()[slot].is_actuator && voters.any(|(voter, _)| cast.graph.sources(voter)[slot])
    }

    /// As long as a voter falls short whose members could work, the emergency stop is not taken back.
    pub(super) fn refuse_while_voters_fall_short(&self) -> Result<(), Refused> {
        let Some(cast) = self.cast.as_ref().filter(|_| emergency::latched()) else { return Ok(()) };
        let mut voters = cast.short_voters();
        voters.find(|(voter, _)| has_members_enough(&cast.graph, *voter)).map_or(Ok(()), |(_, voter)| {
            let Parts { name, demand, members, .. } = voter.parts();
            let members: Vec<&str> = members.iter().map(|member| member.port.as_str()).collect();
            Err(Refused::short(name, demand.require, &members))
        })
    }

    /// The emergency stop is taken back: what falls short by then begins anew.
    pub(super) fn forgive_voters(&mut self) {
        let now_ns = clock::now_ns();
        for (number, voter) in self.cast.iter().flat_map(Cast::short_voters) {
            voter.forgive(now_ns);
            self.situation.vote(number, None);
        }
    }
}

/// True where as many members as must agree work without any actuator.
fn has_members_enough(graph: &Graph, voter: Number) -> bool {
    let is_free = |member: &&Number| {
        let sources = graph.sources(**member);
        !graph.nodes().iter().zip(sources).any(|(node, is_source)| is_source && node.is_actuator)
    };
    let needs = &graph.nodes()[voter].needs;
    needs.iter().all(|need| need.on.iter().filter(is_free).count() >= need.require)
}

impl Cast {
    /// The voters with their numbers.
    fn numbered(&self) -> impl Iterator<Item = (Number, &Arc<Voter>)> {
        self.graph.voters().zip(&self.voters)
    }

    /// Those that are the emergency stop's, and fall short now.
    fn short_voters(&self) -> impl Iterator<Item = (Number, &Arc<Voter>)> {
        self.numbered().filter(|(_, voter)| voter.parts().severity == Severity::Emergency && voter.falls_short())
    }
}
