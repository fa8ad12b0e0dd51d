//! A small system, drawn by lot: applications of slots, who needs whom, executors, rules; and the plan of it.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use framework_daemon::fault::graph::Graph;
use framework_daemon::model::ladder::Ladder;
use framework_daemon::model::schedule::Schedule;
use framework_daemon::model::symptom::{Severity, SeverityTable, Symptom};
use framework_daemon::profile::plan::{
    ApplicationDependencyPlan, ComponentPlan, ConnectionPlan, Coverage, DependencyPlan, Execution, FaultRules,
    Location, NeededPlan, Plan, PortKind, PortRef, SlotPlan, SystemPlan, Trigger, VotingMethod, VotingPlan,
};

use crate::sim::dice::Dice;

/// Symptoms that are provoked: of each kind one.
pub(super) const SYMPTOMS: [Symptom; 3] = [Symptom::CrashSegv, Symptom::Error, Symptom::Validity];

/// A slot.
pub(super) struct Slot {
    pub(super) application: usize,
    pub(super) executor: usize,
    pub(super) coverage: Coverage,
    pub(super) is_actuator: bool,
    pub(super) autostart: bool,
    pub(super) severity: SeverityTable,
    pub(super) limit: u32,
    pub(super) within: Duration,
    pub(super) secondaries: usize,
}

/// A voter, whose number is that of the last slot and its own place: so many of its members must agree.
pub(super) struct Voter {
    /// Slots, and voters before it.
    pub(super) members: Vec<usize>,
    pub(super) require: usize,
    pub(super) severity: Severity,
    application: usize,
    rank: u64,
}

/// A slot needs so many of these groups, each of which works while all in it do; a voter is a group of its own.
pub(super) struct Need {
    pub(super) slot: usize,
    pub(super) on: Vec<Vec<usize>>,
    pub(super) require: usize,
}

/// An application needs so many of these.
pub(super) struct ApplicationNeed {
    pub(super) application: usize,
    pub(super) on: Vec<usize>,
    pub(super) require: usize,
}

/// The system.
pub(super) struct Drawn {
    pub(super) slots: Vec<Slot>,
    pub(super) voters: Vec<Voter>,
    pub(super) needs: Vec<Need>,
    pub(super) application_needs: Vec<ApplicationNeed>,
    /// Writers, slots or voters, and readers.
    pub(super) links: Vec<(usize, usize)>,
}

impl Drawn {
    pub(super) fn by(dice: &Dice) -> Self {
        let (count, applications) = (1 + dice.below(12), 1 + dice.below(3));
        let slots: Vec<Slot> = (0..count).map(|_| slot(dice, applications)).collect();
        // Who is needed has the lesser rank, so that there is no circle; ranks and numbers have nothing in common.
        let ranks: Vec<u64> = (0..count).map(|_| dice.any()).collect();
        let mut voters = Vec::new();
        for _ in 0..dice.below(4) {
            voters.extend(voter(dice, &slots, &ranks, &voters));
        }
        let needs = (0..dice.below(count + 2)).filter_map(|_| need(dice, &slots, &voters, &ranks)).collect();
        let application_needs =
            (0..dice.below(applications + 1)).filter_map(|_| application_need(dice, applications)).collect();
        let links = (0..dice.below(count + 3)).map(|_| (dice.below(count + voters.len()), dice.below(count)));
        let links = links.collect();
        Self { slots, voters, needs, application_needs, links }
    }

    pub(super) fn ladders(&self) -> Vec<Ladder> {
        let ladder =
            |slot: &Slot| Ladder::new(slot.severity.clone(), Some((slot.limit, slot.within)), slot.secondaries);
        self.slots.iter().map(ladder).collect()
    }

    /// As the daemon compiles it.
    pub(super) fn graph(&self) -> Graph {
        let executors: Vec<usize> = self.slots.iter().map(|slot| slot.executor).collect();
        Graph::compile(&self.plan(), &executors)
    }

    fn plan(&self) -> Plan {
        let classes = [component(false), component(true)];
        let numbered = || self.slots.iter().enumerate();
        let group = |slots: &Vec<usize>| {
            let slots: Vec<String> = slots.iter().map(|slot| self.name(*slot)).collect();
            NeededPlan { name: slots.join("+"), slots }
        };
        let dependency = |need: &Need| DependencyPlan {
            slot: name(need.slot),
            on: need.on.iter().map(group).collect(),
            require: need.require,
            location: Location::default(),
        };
        let between = |need: &ApplicationNeed| ApplicationDependencyPlan {
            application: application(need.application),
            on: need.on.iter().map(|number| application(*number)).collect(),
            require: need.require,
            location: Location::default(),
        };
        Plan {
            root: PathBuf::new(),
            system: SystemPlan {
                dependencies: self.application_needs.iter().map(between).collect(),
                emergency: numbered().filter(|(_, slot)| slot.is_actuator).map(|(number, _)| name(number)).collect(),
                ..SystemPlan::default()
            },
            applications: Vec::new(),
            slots: numbered().map(|(number, slot)| slot_plan(number, slot, &classes)).collect(),
            connections: self.links.iter().map(|link| self.connection(link)).collect(),
            composites: Vec::new(),
            dependencies: self.needs.iter().map(dependency).collect(),
            order: Vec::new(),
            monitors: Vec::new(),
            reference_models: Vec::new(),
            votings: self.voters.iter().enumerate().map(|(place, voter)| self.voting(place, voter)).collect(),
        }
    }

    /// The name of a slot or a voter.
    fn name(&self, number: usize) -> String {
        number.checked_sub(self.slots.len()).map_or_else(|| name(number), |place| format!("voter{place}"))
    }

    fn voting(&self, place: usize, voter: &Voter) -> VotingPlan {
        VotingPlan {
            name: Some(self.name(self.slots.len() + place)),
            port: "p".to_owned(),
            data_type: String::new(),
            inputs: voter.members.iter().map(|member| self.end(*member)).collect(),
            method: VotingMethod::Median,
            tolerance: 0.0,
            field: String::new(),
            max_age: None,
            require: voter.require,
            severity: voter.severity,
            location: Location::default(),
        }
    }

    fn end(&self, number: usize) -> PortRef {
        PortRef { slot: self.name(number), port: "p".to_owned() }
    }

    fn connection(&self, link: &(usize, usize)) -> ConnectionPlan {
        ConnectionPlan {
            kind: PortKind::Data,
            source: self.end(link.0),
            target: self.end(link.1),
            validity: Vec::new(),
            on_gone: None,
            location: Location::default(),
        }
    }
}

fn slot(dice: &Dice, applications: usize) -> Slot {
    let mut severity = SeverityTable::opros_default();
    for symptom in SYMPTOMS {
        let drawn = [Severity::Ignore, Severity::Reset, Severity::Reset, Severity::Stop, Severity::Stop];
        let emergency = dice.once_in(12);
        severity.set(symptom, if emergency { Severity::Emergency } else { drawn[dice.below(drawn.len())] });
    }
    let coverage = match dice.below(12) {
        0 => Coverage::Executor,
        1 => Coverage::System,
        _ => Coverage::Component,
    };
    Slot {
        application: dice.below(applications),
        executor: dice.below(4),
        coverage,
        is_actuator: dice.once_in(4),
        autostart: !dice.once_in(6),
        severity,
        limit: dice.below(4) as u32,
        within: Duration::from_millis(1 + dice.below(3000) as u64),
        secondaries: dice.below(3),
    }
}

/// Of slots and voters of one application; whoever is needed through it has a lesser rank.
fn voter(dice: &Dice, slots: &[Slot], ranks: &[u64], before: &[Voter]) -> Option<Voter> {
    let application = slots[dice.below(slots.len())].application;
    let of_slots = (0..slots.len()).filter(|slot| slots[*slot].application == application);
    let of_voters = (0..before.len()).filter(|place| before[*place].application == application);
    let mut members: Vec<usize> = of_slots.chain(of_voters.map(|place| slots.len() + place)).collect();
    members.retain(|_| !dice.once_in(3));
    let rank = |member: &usize| match member.checked_sub(slots.len()) {
        None => ranks[*member],
        Some(place) => before[place].rank,
    };
    let rank = members.iter().map(rank).max()?;
    let severities = [Severity::Ignore, Severity::Stop, Severity::Stop, Severity::Stop, Severity::Emergency];
    let (require, severity) = (1 + dice.below(members.len()), severities[dice.below(severities.len())]);
    Some(Voter { members, require, severity, application, rank })
}

fn need(dice: &Dice, slots: &[Slot], voters: &[Voter], ranks: &[u64]) -> Option<Need> {
    let slot = dice.below(slots.len());
    let may_vote = |voter: &&Voter| voter.application == slots[slot].application && voter.rank < ranks[slot];
    let votes = voters.iter().position(|voter| may_vote(&voter)).filter(|_| !dice.once_in(3));
    let may = |other: usize| slots[other].application == slots[slot].application && ranks[other] < ranks[slot];
    let others: Vec<usize> = (0..slots.len()).filter(|other| may(*other)).collect();
    if others.is_empty() {
        return None;
    }
    let group = |_| (0..1 + dice.below(2)).map(|_| others[dice.below(others.len())]).collect::<Vec<usize>>();
    let mut on: Vec<Vec<usize>> = (0..1 + dice.below(3)).map(group).collect();
    on.iter_mut().for_each(|group| {
        group.sort_unstable();
        group.dedup();
    });
    on.extend(votes.map(|place| vec![slots.len() + place]));
    let require = 1 + dice.below(on.len());
    Some(Need { slot, on, require })
}

fn application_need(dice: &Dice, applications: usize) -> Option<ApplicationNeed> {
    let application = dice.below(applications);
    let on: Vec<usize> = (0..application).filter(|_| !dice.once_in(3)).collect();
    let require = 1 + dice.below(on.len());
    (!on.is_empty()).then_some(ApplicationNeed { application, on, require })
}

fn name(slot: usize) -> String {
    format!("slot{slot}")
}

fn application(number: usize) -> String {
    format!("application{number}")
}

fn component(autostart: bool) -> Arc<ComponentPlan> {
    let (trigger, schedule) = (Trigger::Passive, Schedule::default());
    Arc::new(ComponentPlan {
        name: String::new(),
        version: String::new(),
        library: String::new(),
        execution: Execution { trigger, schedule, deadline: None, stack: None, autostart, singleton: false },
        properties: Vec::new(),
        data_ports: Vec::new(),
        event_ports: Vec::new(),
        service_ports: Vec::new(),
        location: Location::default(),
    })
}

fn slot_plan(number: usize, slot: &Slot, classes: &[Arc<ComponentPlan>; 2]) -> SlotPlan {
    SlotPlan {
        name: name(number),
        application: application(slot.application),
        component: Arc::clone(&classes[usize::from(slot.autostart)]),
        properties: Vec::new(),
        executor: None,
        node: None,
        rules: FaultRules { severity: slot.severity.clone(), coverage: slot.coverage, ..FaultRules::default() },
        location: Location::default(),
    }
}
