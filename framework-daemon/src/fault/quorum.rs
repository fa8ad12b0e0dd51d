//! What follows from a voter's own fault: too few of its members agree, so that it hands nothing on.
//!
//! A voter has no executor that would answer it, and no instance that could be reset. The emergency stop it raised itself; here
//! those that depend on it are stopped, and return when enough agree again. While a voter whose rule is the emergency stop
//! falls short, or did not vote yet in this run, that is not taken back: whoever looks sees to its members first, and for that
//! all that it hears may be started and reset although it is latched, until all of it runs. Unless too few of its members can
//! work at all without the actuators: then it is taken back, and they have the time again in which each may be silent.

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
            self.recent.remember(voter, event.fault.symptom, event.fault.at_ns, root);
        }
        if !stops_others(event.severity) {
            return Vec::new();
        }
        self.situation.vote(voter, fault);
        self.settle()
    }

    /// Of which fault it is a consequence that too few members of a voter agree: one by which it lost a member, after that said
    /// last what enough agreed with. How long ago that is does not matter: who may be silent for long is missed late.
    pub(super) fn root_of_quorum(&self, cast: &Cast, event: &FaultEvent) -> Option<u64> {
        let (number, voter) = cast.numbered().find(|(_, voter)| voter.parts().name == event.slot)?;
        let members = &cast.graph.nodes()[number].needs.first()?.on;
        let lost = members.iter().zip(voter.lost_ns()).filter_map(|(member, since_ns)| Some((*member, since_ns?)));
        self.recent.root_of_loss(&cast.graph, number, &lost.collect::<Vec<_>>(), event.fault.at_ns)
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

    /// True of a slot that may be started or reset although the emergency stop is latched: a voter that raises it lacks what it
    /// says. As long as one of its sources does not run: where two of three agree, the third one is to come back as well.
    pub(super) fn is_missed(&self, cast: &Cast, slot: Number) -> bool {
        let is_missed_by = |(number, voter): (Number, &Arc<Voter>)| {
            let sources = cast.graph.sources(number);
            let lacks = |source: Number| sources[source] && !self.situation.runs(source);
            sources[slot] && (!voter.agrees() || (0..cast.graph.slots()).any(lacks))
        };
        !cast.graph.nodes()[slot].is_actuator && cast.emergency_voters().any(is_missed_by)
    }

    /// As long as members of a voter do not agree that could work, the emergency stop is not taken back.
    pub(super) fn refuse_while_voters_fall_short(&self) -> Result<(), Refused> {
        let Some(cast) = self.cast.as_ref().filter(|_| emergency::latched()) else { return Ok(()) };
        let mut voters = cast.voters_without_vote();
        voters.find(|(voter, _)| has_members_enough(&cast.graph, *voter)).map_or(Ok(()), |(_, voter)| {
            let Parts { name, demand, members, .. } = voter.parts();
            let members: Vec<&str> = members.iter().map(|member| member.port.as_str()).collect();
            let refused = if voter.falls_short() { Refused::short } else { Refused::without_vote };
            Err(refused(name, demand.require, &members))
        })
    }

    /// The emergency stop is taken back: where not enough members agree by then, they begin anew.
    pub(super) fn forgive_voters(&mut self) {
        let now_ns = clock::now_ns();
        for (number, voter) in self.cast.iter().flat_map(Cast::voters_without_vote) {
            voter.forgive(now_ns);
            self.situation.vote(number, None);
        }
    }
}

/// True where as many members as must agree work without any actuator.
fn has_members_enough(graph: &Graph, voter: Number) -> bool {
    let is_free = |member: &&Number| {
        let sources = graph.sources(**member);
        !graph.nodes().iter().zip(sources).any(|(node, is_source)| is_source && node.waits_for_clear())
    };
    let needs = &graph.nodes()[voter].needs;
    needs.iter().all(|need| need.on.iter().filter(is_free).count() >= need.require)
}

impl Cast {
    /// The voters with their numbers.
    fn numbered(&self) -> impl Iterator<Item = (Number, &Arc<Voter>)> {
        self.graph.voters().zip(&self.voters)
    }

    /// Those that raise the emergency stop.
    fn emergency_voters(&self) -> impl Iterator<Item = (Number, &Arc<Voter>)> {
        self.numbered().filter(|(_, voter)| voter.parts().severity == Severity::Emergency)
    }

    /// Those of them of which not enough members agree now, as far as anybody knows.
    fn voters_without_vote(&self) -> impl Iterator<Item = (Number, &Arc<Voter>)> {
        self.emergency_voters().filter(|(_, voter)| !voter.agrees())
    }
}
