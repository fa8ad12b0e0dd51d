//! Models and voters of a plan: ears put at the outputs that they are about, after everything is connected.
//!
//! What a reload does not change stays as it is, with what it has heard: a window need not fill again because another slot came.

use std::sync::Arc;

use component_sdk::object::TypeDescriptor;
use component_sdk::object::path::PathError;

use super::blueprint::Blueprint;
use super::system::Placed;
use super::watch::Look;
use super::wiring::{at, complain};
use crate::detect::{model_diff, poll};
use crate::exec::emergency;
use crate::model::fault::{FaultSender, Label};
use crate::model::limits::VOTER_AGE;
use crate::model::names;
use crate::model::time::nanoseconds;
use crate::port::check::Checks;
use crate::port::comparer::Comparer;
use crate::port::output::OutPort;
use crate::port::pattern::provider::Openness;
use crate::port::tap::{Probe, Tap};
use crate::port::voter::{Member, Parts, Voter};
use crate::profile::plan::{ConnectionPlan, Location, Plan, PortKind, PortRef, ReferenceModelPlan, VotingPlan};
use crate::sys::clock;

/// An ear, and the port that it is put at.
#[derive(Clone)]
struct Ear {
    port: Arc<OutPort>,
    tap: Arc<dyn Tap>,
}

/// Something that the framework inserted, after a plan.
pub struct Inserted<P, H> {
    /// What the profile says.
    pub plan: P,
    /// What does it.
    pub helper: Arc<H>,
    ears: Vec<Ear>,
}

impl<P: Clone, H> Clone for Inserted<P, H> {
    fn clone(&self) -> Self {
        Self { plan: self.plan.clone(), helper: Arc::clone(&self.helper), ears: self.ears.clone() }
    }
}

/// All that the framework inserted.
#[derive(Clone, Default)]
pub struct Helpers {
    /// Voters, those that others vote over first.
    pub voters: Vec<Inserted<VotingPlan, Voter>>,
    /// Models that are compared.
    pub models: Vec<Inserted<ReferenceModelPlan, Comparer>>,
}

impl Helpers {
    /// The output of a voter.
    #[must_use]
    pub fn output(&self, PortRef { slot, port }: &PortRef) -> Option<&Arc<OutPort>> {
        let named =
            |voter: &&Inserted<VotingPlan, Voter>| voter.plan.name.as_ref() == Some(slot) && voter.plan.port == *port;
        self.voters.iter().find(named).map(|voter| &voter.helper.parts().output)
    }

    /// From now on, if not before, the members of voters are to speak: all that start by themselves have been started.
    pub fn expect(&self) {
        let now_ns = clock::now_ns();
        self.voters.iter().for_each(|voter| voter.helper.expect(now_ns));
    }

    /// Who looks for silence at the voters.
    pub fn looks(&self) -> impl Iterator<Item = Look> {
        self.voters.iter().map(|voter| {
            let voter = Arc::clone(&voter.helper);
            Box::new(move |now_ns| voter.look(now_ns)) as Look
        })
    }

    /// Voters that others may connect to, with their names.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, &Inserted<VotingPlan, Voter>)> {
        self.voters.iter().filter(|voter| voter.plan.name.is_some()).map(|voter| (voter.helper.parts().name, voter))
    }
}

/// Builds what the plan wants inserted. What was there before and is wanted as it is stays.
///
/// # Errors
/// All that is wrong, one text each.
pub fn build(before: &Helpers, plan: &Plan, slots: &[Placed], faults: &FaultSender) -> Result<Helpers, Vec<String>> {
    let (mut helpers, mut errors) = (Helpers::default(), Vec::new());
    for voting in &plan.votings {
        let built = ports(&voting.inputs, slots, &helpers).and_then(|ports| voter(before, voting, ports, faults));
        match built {
            Ok(voter) => helpers.voters.push(voter),
            Err(reason) => errors.push(at(&voting.location, &reason)),
        }
    }
    for wanted in &plan.reference_models {
        let both = [wanted.target.clone(), wanted.model.clone()];
        match ports(&both, slots, &helpers).and_then(|ports| model(before, wanted, ports)) {
            Ok(model) => helpers.models.push(model),
            Err(reason) => errors.push(at(&wanted.location, &reason)),
        }
    }
    if errors.is_empty() { Ok(helpers) } else { Err(errors) }
}

/// The outputs of those names.
fn ports(names: &[PortRef], slots: &[Placed], helpers: &Helpers) -> Result<Vec<Arc<OutPort>>, String> {
    let find = |end: &PortRef| {
        let placed = slots.iter().find(|placed| placed.slot.name == end.slot);
        let port = placed.and_then(|placed| placed.slot.output(&end.port)).or_else(|| helpers.output(end));
        port.cloned().ok_or_else(|| format!("{}.{}: no such output", end.slot, end.port))
    };
    names.iter().map(find).collect()
}

/// The one that was there before, if it is after the same plan and at the same ports.
fn kept<P: Clone, H>(
    before: &[Inserted<P, H>],
    ports: &[Arc<OutPort>],
    same: impl Fn(&P) -> bool,
) -> Option<Inserted<P, H>> {
    let at_same = |one: &&Inserted<P, H>| {
        let places = one.ears.iter().map(|ear| Arc::as_ptr(&ear.port));
        same(&one.plan) && places.eq(ports.iter().map(Arc::as_ptr))
    };
    before.iter().find(at_same).cloned()
}

fn voter(
    before: &Helpers,
    plan: &VotingPlan,
    ports: Vec<Arc<OutPort>>,
    faults: &FaultSender,
) -> Result<Inserted<VotingPlan, Voter>, String> {
    let same = |old: &VotingPlan| VotingPlan { location: plan.location.clone(), ..old.clone() } == *plan;
    if let Some(kept) = kept(&before.voters, &ports, same) {
        return Ok(kept);
    }
    let objects: Vec<&'static TypeDescriptor> = ports.iter().map(|port| port.object).collect();
    let (object, probes) = ballot(plan, &objects)?;
    let members = plan.inputs.iter().zip(&ports);
    let members =
        members.filter_map(|(end, port)| Some(Member { port: full_name(end), charges: port.accused()? })).collect();
    let output = Arc::new(OutPort::new(&plan.port, object, Checks::default()));
    output.set_open(Openness::Serving);
    let helper = Voter::new(Parts {
        name: names::intern(plan.name.as_deref().unwrap_or("voting")),
        demand: poll::Demand {
            method: plan.method,
            tolerance: plan.tolerance,
            max_age_ns: nanoseconds(plan.max_age.unwrap_or(VOTER_AGE)),
            require: plan.require,
        },
        stale: plan.max_age.is_some(),
        field: Label::new(&plan.field),
        members,
        output,
        faults: faults.clone(),
        severity: plan.severity,
        alarm: emergency::raise,
    });
    let ears = ports.into_iter().zip(probes).enumerate();
    let ears = ears.map(|(member, (port, probe))| Ear { port, tap: helper.ear(member, probe) }).collect();
    Ok(Inserted { plan: plan.clone(), helper, ears })
}

/// What all of them carry, and where in each of them the number lies.
fn ballot(
    plan: &VotingPlan,
    objects: &[&'static TypeDescriptor],
) -> Result<(&'static TypeDescriptor, Vec<Probe>), String> {
    let (Some(first), Some(name)) = (objects.first(), plan.inputs.first()) else {
        return Err("nobody votes".to_owned());
    };
    for (end, object) in plan.inputs.iter().zip(objects) {
        if let Some(difference) = first.difference(object) {
            return Err(format!(
                "{}.{} carries {}, {}.{} carries {}, and their layouts differ: {difference}; only the same can be voted \
                 over",
                name.slot, name.port, first.name, end.slot, end.port, object.name
            ));
        }
    }
    let probes = objects.iter().map(|object| probe(object, &plan.field)).collect::<Result<_, _>>()?;
    Ok((first, probes))
}

fn model(
    before: &Helpers,
    plan: &ReferenceModelPlan,
    ports: Vec<Arc<OutPort>>,
) -> Result<Inserted<ReferenceModelPlan, Comparer>, String> {
    let same =
        |old: &ReferenceModelPlan| ReferenceModelPlan { location: plan.location.clone(), ..old.clone() } == *plan;
    if let Some(kept) = kept(&before.models, &ports, same) {
        return Ok(kept);
    }
    let objects: Vec<&'static TypeDescriptor> = ports.iter().map(|port| port.object).collect();
    let probes = objects.iter().map(|object| probe(object, &plan.field)).collect::<Result<Vec<_>, _>>()?;
    let target = full_name(&plan.target);
    let name = format!("model {} of {}", full_name(&plan.model).as_str(), target.as_str());
    let demand =
        model_diff::Demand { window_ns: nanoseconds(plan.window), threshold: plan.threshold, measure: plan.measure };
    let blamed = ports.first().and_then(|port| port.accused()).ok_or("nobody answers for its target")?;
    let helper = Comparer::new(name, target, &plan.field, demand, blamed);
    let sides = [model_diff::Side::Target, model_diff::Side::Model].into_iter().zip(probes);
    let ears = ports.into_iter().zip(sides);
    let ears = ears.map(|(port, (side, probe))| Ear { port, tap: helper.ear(side, probe) }).collect();
    Ok(Inserted { plan: plan.clone(), helper, ears })
}

fn full_name(PortRef { slot, port }: &PortRef) -> Label {
    Label::of(format_args!("{slot}.{port}"))
}

fn probe(object: &'static TypeDescriptor, field: &str) -> Result<Probe, String> {
    Probe::new(object, field).map_err(|error| {
        let name = object.name;
        match error {
            PathError::Several => {
                format!("field `{field}` of {name} holds several numbers: name one of them, {field}[0]")
            }
            PathError::Unknown { part, known } => {
                format!("{name} has no field `{part}`; there are: {}", known.join(", "))
            }
            PathError::NoNumber => {
                format!("field `{field}` of {name} holds no numbers: name one inside it")
            }
            PathError::NoPlace { place, count } => {
                format!("field `{field}` of {name}: there is no place {place} among {count}")
            }
        }
    })
}

/// Puts the ears at their ports, and takes away those that are not wanted any more.
pub fn apply(helpers: &Helpers, slots: &[Placed]) {
    let of_voters = helpers.voters.iter().map(|voter| (voter.helper.parts().name, &voter.helper.parts().output));
    let of_slots = slots.iter().flat_map(|placed| placed.slot.outputs.iter().map(|port| (placed.slot.name, port)));
    for (slot, port) in of_voters.chain(of_slots) {
        let all =
            helpers.voters.iter().flat_map(|one| &one.ears).chain(helpers.models.iter().flat_map(|one| &one.ears));
        let taps: Vec<Arc<dyn Tap>> =
            all.filter(|ear| Arc::ptr_eq(&ear.port, port)).map(|ear| Arc::clone(&ear.tap)).collect();
        if (!taps.is_empty() || port.taps().is_some()) && port.listen(taps).is_err() {
            complain(slot, &port.name);
        }
    }
}

/// What is wrong with models and voters of slots that do not exist yet.
#[must_use]
pub fn check(plan: &Plan, blueprints: &[Blueprint<'_>]) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut tell = |location: &Location, result: Result<(), String>| {
        wrong.extend(result.err().map(|reason| at(location, &reason)));
    };
    for voting in &plan.votings {
        let objects: Option<Vec<_>> = voting.inputs.iter().map(|end| object(plan, blueprints, end)).collect();
        objects.into_iter().for_each(|objects| tell(&voting.location, ballot(voting, &objects).map(drop)));
    }
    for model in &plan.reference_models {
        for object in [&model.target, &model.model].into_iter().filter_map(|end| object(plan, blueprints, end)) {
            tell(&model.location, probe(object, &model.field).map(drop));
        }
    }
    wrong
}

/// What an output carries: that of a slot, or of a voter.
#[must_use]
pub fn object(plan: &Plan, blueprints: &[Blueprint<'_>], end: &PortRef) -> Option<&'static TypeDescriptor> {
    if let Some(slot) = blueprints.iter().find(|blueprint| blueprint.name() == end.slot) {
        return slot.output_object(&end.port);
    }
    // A voter's inputs were named before it: this comes to an end.
    let voting = plan.votings.iter().find(|voting| voting.name.as_ref() == Some(&end.slot))?;
    object(plan, blueprints, voting.inputs.first()?)
}

/// The plan's connections, and those through voters: what flows to whom.
#[must_use]
pub fn flow(plan: &Plan) -> Vec<ConnectionPlan> {
    let through = plan.votings.iter().filter_map(|voting| {
        let target = PortRef { slot: voting.name.clone()?, port: voting.port.clone() };
        Some(voting.inputs.iter().map(move |source| ConnectionPlan {
            kind: PortKind::Data,
            source: source.clone(),
            target: target.clone(),
            validity: Vec::new(),
            on_gone: None,
            location: voting.location.clone(),
        }))
    });
    plan.connections.iter().cloned().chain(through.flatten()).collect()
}
