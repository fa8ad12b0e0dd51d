//! A fault that is the consequence of one upstream: it waits for what is done about its root ([`crate::model::chain`]).
//!
//! Who can be its root is looked up when the plan is known; at a fault one word of each is read, without a lock. The rules of
//! the slot are asked again when the window of the root is over and the symptom is not. What detectors tell of once, a silence
//! or a comparison that is lost, is kept until then; after a bad value the checks begin anew, and tell again of the next bad
//! one; an error that is returned comes again by itself.

use std::sync::Arc;

use super::member::{Crew, Member};
use crate::model::chain;
use crate::model::fault::{Evidence, Fault, Label, Stage};
use crate::model::lifecycle::State;
use crate::model::limits::CONSEQUENCES;
use crate::model::symptom::Symptom;
use crate::port::charge::Charges;
use crate::port::voter::Shortfall;
use crate::profile::plan::Coverage;
use crate::sys::clock;

/// Who may be the root of a slot's faults.
pub struct Upstream {
    /// The slot.
    pub charges: Arc<Charges>,
    /// The voters on the way: as long as enough members of one of them agree, nothing of the slot shows beyond it.
    pub through: Box<[Arc<Shortfall>]>,
}

impl Upstream {
    /// Until when it is the root of what began at `onset_ns`.
    fn root_until_ns(&self, onset_ns: u64) -> Option<u64> {
        let shows = self.through.iter().all(|voter| voter.lapse().reaches(onset_ns));
        self.charges.root().root_until_ns(onset_ns).filter(|_| shows)
    }
}

/// Who may be the root of a slot's faults, nearest first, and which of those wait.
pub struct Chain {
    upstream: Box<[Upstream]>,
    waiting: [Option<Waiting>; CONSEQUENCES],
}

struct Waiting {
    fault: Fault,
    until_ns: u64,
}

impl Chain {
    /// None wait yet.
    #[must_use]
    pub fn new(upstream: Box<[Upstream]>) -> Self {
        Self { upstream, waiting: [const { None }; CONSEQUENCES] }
    }

    /// Takes over those that are on top now; what waits goes on waiting.
    pub fn change(&mut self, upstream: Box<[Upstream]>) {
        self.upstream = upstream;
    }

    /// The nearest root of a fault that began then, and until when it is that.
    fn root(&self, onset_ns: u64) -> Option<(&'static str, u64)> {
        self.upstream.iter().find_map(|slot| Some((slot.charges.slot, slot.root_until_ns(onset_ns)?)))
    }

    /// False: as many wait already.
    fn wait(&mut self, fault: &Fault, until_ns: u64) -> bool {
        if !is_told_once(fault.symptom) {
            return true;
        }
        let known = self.waiting.iter().position(|place| place.as_ref().is_some_and(|one| is_same(&one.fault, fault)));
        let Some(place) = known.or_else(|| self.waiting.iter().position(Option::is_none)) else { return false };
        self.waiting[place] = Some(Waiting { fault: *fault, until_ns });
        true
    }

    /// That fault is over. A bad value may be back without being told of: it is looked at all the same.
    fn heal(&mut self, fault: &Fault) {
        let is_over = |one: &mut Waiting| is_same(&one.fault, fault) && !is_of_value(fault.symptom);
        self.waiting.iter_mut().for_each(|place| _ = place.take_if(is_over));
    }

    /// The slot begins anew: what waited was another life's.
    pub fn forget(&mut self) {
        self.waiting.iter_mut().for_each(|place| *place = None);
    }

    fn due(&mut self, now_ns: u64) -> Option<Fault> {
        let due = self.waiting.iter_mut().find_map(|place| place.take_if(|one| one.until_ns < now_ns));
        due.map(|one| one.fault)
    }

    /// When to look again; `None`: nothing waits.
    #[must_use]
    pub fn until_ns(&self) -> Option<u64> {
        self.waiting.iter().flatten().map(|one| one.until_ns).min()
    }
}

const fn is_of_value(symptom: Symptom) -> bool {
    matches!(symptom, Symptom::Validity | Symptom::Rate)
}

const fn is_told_once(symptom: Symptom) -> bool {
    is_of_value(symptom) || matches!(symptom, Symptom::Stale | Symptom::Model | Symptom::Vote)
}

fn is_same(one: &Fault, other: &Fault) -> bool {
    let port = |fault: &Fault| match fault.evidence {
        Evidence::Value { port, .. }
        | Evidence::Model { port, .. }
        | Evidence::Vote { port, .. }
        | Evidence::Silence { port, .. } => Some(port),
        _ => None,
    };
    let (one_port, other_port) = (port(one), port(other));
    one.symptom == other.symptom && one_port.as_ref().map(Label::as_str) == other_port.as_ref().map(Label::as_str)
}

impl Member {
    /// Leaves a fault to the answer to its root, where it has one and may wait; the slot is a root itself else. Returns
    /// whether it was left.
    pub(super) fn leaves(&mut self, fault: &Fault, crew: &mut Crew) -> bool {
        let charges = &self.slot.charges;
        let onset_ns = charges.root().onset_ns(fault.at_ns);
        let left = self.chain.as_mut().and_then(|chain| {
            let severity = self.ladder.severity(fault.symptom);
            let may_wait = chain::may_wait(fault.symptom, severity, self.coverage == Coverage::System);
            let (cause, until_ns) = chain.root(onset_ns).filter(|_| may_wait)?;
            chain.wait(fault, until_ns).then_some((cause, until_ns))
        });
        let Some((cause, until_ns)) = left else {
            charges.take_up(fault.symptom, onset_ns);
            return false;
        };
        charges.leave();
        crew.look_again_ns = crew.look_again_ns.min(until_ns.saturating_add(1));
        self.note_consequence(fault, cause, crew);
        true
    }

    /// Something is over: what waits of it need not be answered any more.
    pub(super) fn note_end(&mut self, fault: &Fault) {
        if fault.stage != Stage::Confirmed {
            self.chain.iter_mut().for_each(|chain| chain.heal(fault));
        }
    }

    /// What waited long enough and is still there is a fault of the slot's own.
    pub(super) fn look_again(&mut self, now_ns: u64, crew: &mut Crew) {
        // Whatever was told of by now lies before that.
        let now_ns = clock::now_ns().max(now_ns);
        while let Some(fault) = self.chain.as_mut().and_then(|chain| chain.due(now_ns)) {
            if self.state() != State::Active {
                continue;
            }
            // Its root failed again: that is nothing new to tell.
            let waits = |chain: &mut Box<Chain>| chain.root(now_ns).is_some_and(|(_, until)| chain.wait(&fault, until));
            if self.chain.as_mut().is_some_and(waits) {
                continue;
            }
            if is_of_value(fault.symptom) {
                self.slot.outputs.iter().for_each(|port| port.forget_episodes());
            } else {
                self.handle(&Fault { at_ns: now_ns, detected_ns: now_ns, ..fault }, crew);
            }
        }
    }
}
