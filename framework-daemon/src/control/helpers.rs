//! Models and voters as they are shown: what the framework inserted has no thread and no instance, but it is there.

use serde_json::{Value, json};

use super::directory::{Directory, Wires};
use super::views;
use crate::detect::vote::Members;
use crate::port::comparer::Comparer;
use crate::port::voter::Voter;
use crate::profile::plan::{PortRef, ReferenceModelPlan, VotingPlan};
use crate::supervise::helpers::Inserted;

/// All of them.
pub(super) fn all(directory: &Directory) -> Vec<Value> {
    let voters = directory.helpers.voters.iter().map(voter);
    voters.chain(directory.helpers.models.iter().map(model)).collect()
}

fn voter(Inserted { plan, helper, .. }: &Inserted<VotingPlan, Voter>) -> Value {
    let tally = helper.tally();
    let named =
        |members: Members| -> Vec<String> { members.iter().filter_map(|at| plan.inputs.get(at)).map(full).collect() };
    let last = tally.last.map(|vote| vote.outcome);
    json!({"helper": helper.parts().name, "kind": "voter", "of": plan.inputs.iter().map(full).collect::<Vec<_>>(),
        "field": plan.field, "method": plan.method, "tolerance": plan.tolerance, "require": plan.require,
        "severity": plan.severity, "falls_short": helper.falls_short(), "agrees": helper.agrees(), "votes": tally.votes, "winner": last.and_then(|last| last.winner).map(|(_, value)| value),
        "agreeing": last.map(|last| named(last.agreeing)).unwrap_or_default(),
        "outvoted": last.map(|last| named(last.minority)).unwrap_or_default()})
}

/// All that is known of a voter; `None`: there is none of that name.
pub(super) fn details(directory: &Directory, name: &str) -> Option<Value> {
    let (name, one) = directory.helpers.named().find(|(own, _)| *own == name)?;
    let mut fields = voter(one);
    fields["slot"] = name.into();
    fields["max_age_ns"] = one.helper.parts().demand.max_age_ns.into();
    fields["ports"] = ports(directory, &directory.wires(), Some(name)).into();
    Some(fields)
}

fn model(Inserted { plan, helper, .. }: &Inserted<ReferenceModelPlan, Comparer>) -> Value {
    let last = helper.last();
    json!({"helper": full(&plan.model), "kind": "model", "of": [full(&plan.target)], "field": plan.field,
        "compare": plan.measure, "window_ns": plan.window.as_nanos() as u64, "threshold": plan.threshold,
        "target": last.map(|last| last.target), "model": last.map(|last| last.model),
        "difference": last.map(|last| last.difference())})
}

fn full(PortRef { slot, port }: &PortRef) -> String {
    format!("{slot}.{port}")
}

/// What a person reads of them, a line each.
#[must_use]
pub fn lines(helpers: &[Value]) -> Vec<String> {
    let line = |helper: &Value| {
        let shown = |name: &str| views::cell(&helper[name]);
        match helper["kind"].as_str() {
            Some("voter") => format!(
                "voter {} over {}: {} votes; {} agree; outvoted: {}{}",
                shown("helper"),
                shown("of"),
                shown("votes"),
                helper["agreeing"].as_array().map_or(0, Vec::len),
                shown("outvoted"),
                match (&helper["falls_short"], &helper["agrees"]) {
                    (Value::Bool(true), _) => "; TOO FEW AGREE",
                    (_, Value::Bool(false)) => "; they have not agreed yet",
                    _ => "",
                }
            ),
            _ => format!(
                "model {} of {}: {}, model {}, difference {} of at most {}",
                shown("helper"),
                shown("of"),
                shown("target"),
                shown("model"),
                shown("difference"),
                shown("threshold")
            ),
        }
    };
    helpers.iter().map(line).collect()
}

/// The outputs of voters, or of the one of that name.
pub(super) fn ports(directory: &Directory, wires: &Wires, name: Option<&str>) -> Vec<Value> {
    let wanted = directory.helpers.named().filter(|(own, _)| name.is_none_or(|name| name == *own));
    let shown = |(name, one): (&'static str, &Inserted<VotingPlan, Voter>)| {
        let port = &one.helper.parts().output;
        let mut fields = views::output(name, port, wires.of(port));
        fields["direction"] = "voter".into();
        fields["voters"] = one.plan.inputs.iter().map(full).collect::<Vec<_>>().into();
        fields["votes"] = one.helper.tally().votes.into();
        fields
    };
    wanted.map(shown).collect()
}
