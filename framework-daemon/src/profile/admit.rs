//! What a plan promises and cannot keep: rules that nothing wakes, times that do not fit, resets that lead nowhere. Found by
//! `check` before anything runs. Pure: a plan in, doubts out.
//!
//! Each is a warning: the system runs, but not as whoever wrote this thinks.

use std::collections::BTreeMap;
use std::time::Duration;

use super::plan::{
    ConnectionPlan, DataPortPlan, FaultRules, NeededPlan, Overflow, Plan, PortKind, PortRef, Preload, Queue, SlotPlan,
    Trigger, Usage, Validity, VotingPlan,
};
use crate::model::limits::{RECOVERY_LEAST, RECOVERY_LEAST_UNPREPARED};
use crate::model::symptom::{Severity, Symptom};

/// Something that does not hold.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Doubt {
    /// The slot that it is about.
    pub slot: String,
    /// What does not hold.
    pub message: String,
    /// The way out.
    pub hint: &'static str,
}

/// All doubts about a plan, in the order of its slots.
#[must_use]
pub fn doubts(plan: &Plan) -> Vec<Doubt> {
    let mut found = Vec::new();
    for slot in &plan.slots {
        let mut doubt = |(message, hint): (String, &'static str)| {
            found.push(Doubt { slot: slot.name.clone(), message, hint });
        };
        silences(plan, slot).into_iter().for_each(&mut doubt);
        unheard(plan, slot).into_iter().for_each(&mut doubt);
        let own = [hasty(plan, slot), resets(&slot.rules), recovery(slot), deadline(slot)];
        own.into_iter().flatten().for_each(&mut doubt);
    }
    found.extend(crowded(plan));
    found.extend(plan.votings.iter().filter_map(|voting| quorum(plan, voting)));
    found
}

type Said = (String, &'static str);

fn writers<'a>(plan: &'a Plan, slot: &str, port: &str) -> Vec<&'a ConnectionPlan> {
    let ends = |connection: &&ConnectionPlan| {
        let target = &connection.target;
        connection.kind == PortKind::Data && target.slot == slot && target.port == port
    };
    plan.connections.iter().filter(ends).collect()
}

fn period_of(plan: &Plan, slot: &str) -> Option<Duration> {
    let slot = plan.slots.iter().find(|candidate| candidate.name == slot)?;
    match slot.component.execution.trigger {
        Trigger::Periodic(period) => Some(period),
        Trigger::Nonperiodic | Trigger::Passive => None,
    }
}

/// Silence that nobody can keep short, or that nobody is there to keep.
fn silences(plan: &Plan, slot: &SlotPlan) -> Vec<Said> {
    let inputs = slot.component.data_ports.iter().filter(|port| port.usage == Usage::Input);
    let aged = inputs.filter_map(|port| Some((port.name.as_str(), port.max_age?, "<max_age>")));
    let watches = plan.monitors.iter().filter(|monitor| monitor.port.slot == slot.name);
    let watched = watches.clone().filter_map(|monitor| {
        let age = monitor.max_age.filter(|_| !is_lonely_input(plan, slot, &monitor.port))?;
        Some((monitor.port.port.as_str(), age, "<max_age> of the monitor"))
    });
    let ages = aged.chain(watched).filter_map(|(port, age, what)| silence(plan, slot, port, age, what));
    let lonely = watches.filter(|monitor| is_lonely_input(plan, slot, &monitor.port)).map(|monitor| {
        let port = &monitor.port.port;
        let message =
            format!("the monitor of \"{port}\" of \"{}\" watches nothing: nobody is connected there", slot.name);
        (message, "connect the port, or remove the <monitor>")
    });
    ages.chain(lonely).collect()
}

fn is_lonely_input(plan: &Plan, slot: &SlotPlan, port: &PortRef) -> bool {
    let mut inputs = slot.component.data_ports.iter().filter(|each| each.usage == Usage::Input);
    inputs.any(|each| each.name == port.port) && writers(plan, &port.slot, &port.port).is_empty()
}

fn silence(plan: &Plan, slot: &SlotPlan, port: &str, age: Duration, what: &str) -> Option<Said> {
    let sources: Vec<&str> = match writes(slot, port) {
        true => vec![&slot.name],
        false => writers(plan, &slot.name, port).iter().map(|connection| connection.source.slot.as_str()).collect(),
    };
    if sources.is_empty() {
        let message = format!("the {what} of \"{port}\" of \"{}\" is kept by nobody: nothing is connected", slot.name);
        return Some((message, "connect the port, or remove the <max_age>"));
    }
    // One that comes more often, or when it likes, keeps it.
    let slowest = sources.iter().map(|source| period_of(plan, source)).collect::<Option<Vec<_>>>()?;
    let period = slowest.into_iter().min().filter(|period| age <= *period)?;
    let message = format!(
        "the {what} of \"{port}\" of \"{}\", {age:?}, is not longer than the period of who writes there, {period:?}: it is \
         stale all the time",
        slot.name
    );
    Some((message, "allow for several periods: a writer may be late once"))
}

/// A slot that writes only when it is written to, and whose silence is found before that of those who feed it: it is charged with
/// theirs. Chains of symptoms are answered at their root, but not before that is known.
fn hasty(plan: &Plan, slot: &SlotPlan) -> Option<Said> {
    let name = slot.name.as_str();
    let inputs = || slot.component.data_ports.iter().filter(|port| port.usage == Usage::Input);
    let feeds = inputs().flat_map(|port| writers(plan, name, &port.name)).map(|way| way.source.slot.as_str());
    let feeder = feeds.min().filter(|_| slot.component.execution.trigger == Trigger::Nonperiodic)?;
    if slot.rules.severity.get(Symptom::Stale) == Severity::Ignore {
        return None;
    }
    let watched = watching(plan, name).filter_map(|monitor| monitor.max_age);
    // A voter does without a silent member, whosever fault that is.
    let patience = readers(plan, name).filter_map(|port| port.max_age).chain(watched).min()?;
    let own = plan.monitors.iter().filter(|monitor| monitor.port.slot == name && !writes(slot, &monitor.port.port));
    let own = inputs().filter_map(|port| port.max_age).chain(own.filter_map(|monitor| monitor.max_age)).min();
    if own.is_some_and(|own| own < patience) {
        return None;
    }
    let found = own.map_or("nobody finds it out".to_owned(), |own| format!("it is found out after {own:?} only"));
    let message = format!(
        "where \"{feeder}\" falls silent, \"{name}\", which writes only when it is written to, is charged with silence after \
         {patience:?}; of \"{feeder}\" {found}"
    );
    Some((
        message,
        "give its input a <max_age> shorter than that of its readers: what follows from a fault is left to its root",
    ))
}

fn writes(slot: &SlotPlan, port: &str) -> bool {
    slot.component.data_ports.iter().any(|each| each.name == port && each.usage == Usage::Output)
}

/// Severities of symptoms that nothing in the plan can find.
fn unheard(plan: &Plan, slot: &SlotPlan) -> Vec<Said> {
    let deaf = |symptom: &&Symptom| !can_be_found(plan, slot, **symptom);
    let told = |symptom: &Symptom| {
        let name = symptom.name();
        (format!("nothing finds \"{name}\" of \"{}\": this severity is never used", slot.name), found_by(*symptom))
    };
    slot.rules.named.iter().filter(deaf).map(told).collect()
}

const fn found_by(symptom: Symptom) -> &'static str {
    match symptom {
        Symptom::Overrun => "add a <deadline> to its component's execution_semantics",
        Symptom::Validity | Symptom::Rate => "add a <validity> to one of its ports, to a connection, or a <monitor>",
        Symptom::Stale => "add a <max_age> to an input that it is connected to, or a <monitor>",
        Symptom::Model => "add a <reference_model> whose target it is",
        Symptom::Vote => "add a <voting> that it takes part in",
        Symptom::Late => "add <recovery within=\"20ms\"/>",
        _ => "let a FIFO that it writes to say overflow=\"fault\"",
    }
}

fn can_be_found(plan: &Plan, slot: &SlotPlan, symptom: Symptom) -> bool {
    let name = slot.name.as_str();
    match symptom {
        Symptom::Overrun => slot.component.execution.deadline.is_some(),
        Symptom::Late => slot.rules.recovery_within.is_some(),
        Symptom::Validity => is_checked(plan, slot, |rule| rule.min.is_some() || rule.max.is_some()),
        Symptom::Rate => is_checked(plan, slot, |rule| rule.max_rate.is_some()),
        Symptom::Stale => {
            readers(plan, name).any(|port| port.max_age.is_some())
                || watching(plan, name).any(|monitor| monitor.max_age.is_some())
                || votes(plan, name).any(|voting| voting.max_age.is_some())
        }
        Symptom::Overload => {
            readers(plan, name).any(|port| matches!(port.queue, Queue::Fifo { overflow: Overflow::Fault, .. }))
        }
        Symptom::Model => plan.reference_models.iter().any(|model| model.target.slot == name),
        Symptom::Vote => votes(plan, name).next().is_some(),
        _ => true,
    }
}

/// The votings that the slot takes part in.
fn votes<'a>(plan: &'a Plan, slot: &'a str) -> impl Iterator<Item = &'a VotingPlan> {
    plan.votings.iter().filter(move |voting| voting.inputs.iter().any(|input| input.slot == slot))
}

/// True where a rule of that kind holds for what the slot writes, on either end or on the way.
fn is_checked(plan: &Plan, slot: &SlotPlan, is_one: impl Fn(&Validity) -> bool) -> bool {
    let own = slot.component.data_ports.iter().filter(|port| port.usage == Usage::Output).map(|port| &port.validity);
    let ways = plan.connections.iter().filter(|way| way.source.slot == slot.name).map(|way| &way.validity);
    let ends = readers(plan, &slot.name).map(|port| &port.validity);
    let monitors = watching(plan, &slot.name).map(|monitor| &monitor.validity);
    own.chain(ways).chain(ends).chain(monitors).flatten().any(is_one)
}

/// The inputs that the slot's outputs are connected to.
fn readers<'a>(plan: &'a Plan, slot: &'a str) -> impl Iterator<Item = &'a DataPortPlan> {
    let ways = plan.connections.iter().filter(move |way| way.kind == PortKind::Data && way.source.slot == slot);
    ways.filter_map(|way| {
        let reader = plan.slots.iter().find(|slot| slot.name == way.target.slot)?;
        reader.component.data_ports.iter().find(|port| port.name == way.target.port)
    })
}

/// The monitors that see what the slot writes.
fn watching<'a>(plan: &'a Plan, slot: &'a str) -> impl Iterator<Item = &'a super::plan::MonitorPlan> {
    plan.monitors.iter().filter(move |monitor| {
        let port = &monitor.port;
        port.slot == slot || writers(plan, &port.slot, &port.port).iter().any(|way| way.source.slot == slot)
    })
}

/// A severity that wants a reset where none is allowed and nobody takes over.
fn resets(rules: &FaultRules) -> Option<Said> {
    let wants = Symptom::ALL.into_iter().any(|symptom| rules.severity.get(symptom) == Severity::Reset);
    let nowhere = rules.reset.is_some_and(|reset| reset.limit == 0) && rules.secondaries.is_empty();
    (wants && nowhere).then(|| {
        let message = "severity \"reset\" has nothing to reset to: no reset is allowed, and there is no <secondary>";
        (message.to_owned(), "allow a reset, name a <secondary>, or say severity \"stop\"")
    })
}

/// A target that recovery cannot meet, with what is prepared for it.
fn recovery(slot: &SlotPlan) -> Option<Said> {
    let within = slot.rules.recovery_within?;
    if within < RECOVERY_LEAST {
        let message = format!("a recovery within {within:?} is sooner than any executor promises: {RECOVERY_LEAST:?}");
        return Some((message, "declare what the robot needs, not what it may get"));
    }
    if let Some(budget) = slot.component.execution.deadline.map(|deadline| deadline.budget).filter(|it| *it > within) {
        let message = format!(
            "a recovery within {within:?} ends with a first callback, which alone may take its deadline, {budget:?}"
        );
        return Some((message, "declare a target beyond the deadline of the callback"));
    }
    let unprepared = what_is_unprepared(&slot.rules)?;
    (within < RECOVERY_LEAST_UNPREPARED).then(|| {
        let message = format!(
            "a recovery within {within:?} needs {unprepared} that is ready before: to load and make one takes \
             {RECOVERY_LEAST_UNPREPARED:?} and more"
        );
        (message, "say preload=\"instance\", or declare a longer target")
    })
}

fn what_is_unprepared(rules: &FaultRules) -> Option<&'static str> {
    let loses = |symptom: &Symptom| symptom.loses_instance() && rules.severity.get(*symptom) == Severity::Reset;
    let resets = rules.reset.is_none_or(|reset| reset.limit > 0);
    if rules.secondaries.iter().any(|secondary| secondary.preload != Preload::Instance) {
        return Some("a secondary");
    }
    (resets && Symptom::ALL.iter().any(loses) && rules.ready_spares() == 0).then_some("a spare")
}

/// A callback that may take longer than its period.
fn deadline(slot: &SlotPlan) -> Option<Said> {
    let execution = &slot.component.execution;
    let Trigger::Periodic(period) = execution.trigger else { return None };
    let budget = execution.deadline.map(|deadline| deadline.budget).filter(|budget| *budget > period)?;
    let message = format!(
        "the deadline of \"{}\", {budget:?}, is longer than its period, {period:?}: it misses periods",
        slot.name
    );
    Some((message, "a callback must be over before the next one begins"))
}

/// A voter's rule that stops nobody, or a dependency on one that its rule lets go on.
fn quorum(plan: &Plan, voting: &VotingPlan) -> Option<Doubt> {
    let name = voting.name.as_ref()?;
    let needs = |on: &[NeededPlan]| on.iter().any(|needed| needed.slots.contains(name));
    let is_needed = plan.dependencies.iter().any(|dependency| needs(&dependency.on));
    let (message, hint) = match voting.severity {
        Severity::Stop if !is_needed => (
            format!("nothing depends on the voter \"{name}\": its severity \"stop\" stops nobody"),
            "add a <dependency> of who reads it on the voter, or say severity \"emergency\"",
        ),
        Severity::Ignore if is_needed => (
            format!("who depends on the voter \"{name}\" goes on where too few of its members agree: that is ignored"),
            "add <severity>stop</severity> to the <voting>",
        ),
        _ => return None,
    };
    Some(Doubt { slot: name.clone(), message, hint })
}

/// Executors whose slots may need more than all of its time.
fn crowded(plan: &Plan) -> Vec<Doubt> {
    let mut shares: BTreeMap<&str, (&str, f64)> = BTreeMap::new();
    for slot in &plan.slots {
        let execution = &slot.component.execution;
        if let (Some(executor), Trigger::Periodic(period), Some(deadline)) =
            (&slot.executor, execution.trigger, execution.deadline)
        {
            let share = deadline.budget.as_secs_f64() / period.as_secs_f64();
            // One that does not fit alone has been told of.
            let (_, sum) = shares.entry(executor).or_insert((&slot.name, 0.0));
            *sum += if share <= 1.0 { share } else { 0.0 };
        }
    }
    let beyond = shares.into_iter().filter(|(_, (_, sum))| *sum > 1.0 + 1e-9);
    beyond.map(|(executor, (first, sum))| too_many(executor, first, sum)).collect()
}

fn too_many(executor: &str, first: &str, sum: f64) -> Doubt {
    Doubt {
        slot: first.to_owned(),
        message: format!(
            "the deadlines of the slots on executor \"{executor}\" do not fit their periods: together they may take {:.0} % \
             of its time",
            sum * 100.0
        ),
        hint: "give one of them another executor, a shorter deadline or a longer period",
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::model::symptom::SeverityTable;
    use crate::profile::plan::{Intensity, SparePlan};

    fn rules(severity: Severity, limit: u32) -> FaultRules {
        let mut table = SeverityTable::opros_default();
        table.set(Symptom::CrashSegv, severity);
        let reset = Some(Intensity { limit, within: Duration::from_secs(1) });
        FaultRules { severity: table, reset, ..FaultRules::default() }
    }

    #[test]
    fn a_spare_that_is_not_ready_is_seen() {
        let spares =
            |preload| FaultRules { spares: Some(SparePlan { count: 1, preload }), ..rules(Severity::Reset, 3) };
        assert_eq!(what_is_unprepared(&spares(Preload::Library)), Some("a spare"));
        assert_eq!(what_is_unprepared(&spares(Preload::Instance)), None);
        assert_eq!(what_is_unprepared(&rules(Severity::Reset, 3)), None, "one is ready where nothing is said");
    }

    proptest! {
        /// A reset that is wanted, none allowed, nobody else: that, and nothing else, is a doubt.
        #[test]
        fn resets_that_lead_nowhere_are_doubted_and_no_others(limit in 0..5u32, severity in 0..4usize) {
            let severity = Severity::ALL[severity];
            let doubted = resets(&rules(severity, limit)).is_some();
            prop_assert_eq!(doubted, severity == Severity::Reset && limit == 0);
        }
    }
}
