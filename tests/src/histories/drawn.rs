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
    Location, NeededPlan, Plan, PortKind, PortRef, SlotPlan, SystemPlan, Trigger,
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

/// A slot needs so many of these groups, each of which works while all in it do.
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
    pub(super) needs: Vec<Need>,
    pub(super) application_needs: Vec<ApplicationNeed>,
    /// Writers and readers.
    pub(super) links: Vec<(usize, usize)>,
}

impl Drawn {
    pub(super) fn by(dice: &Dice) -> Self {
        let (count, applications) = (1 + dice.below(12), 1 + dice.below(3));
        let slots: Vec<Slot> = (0..count).map(|_| slot(dice, applications)).collect();
        // Who is needed has the lesser rank, so that there is no circle; ranks and numbers have nothing in common.
        let ranks: Vec<u64> = (0..count).map(|_| dice.any()).collect();
        let needs = (0..dice.below(count + 2)).filter_map(|_| need(dice, &slots, &ranks)).collect();
        let application_needs =
            (0..dice.below(applications + 1)).filter_map(|_| application_need(dice, applications)).collect();
        let links = (0..dice.below(count + 3)).map(|_| (dice.below(count), dice.below(count))).collect();
        Self { slots, needs, application_needs, links }
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
            let slots: Vec<String> = slots.iter().map(|slot| name(*slot)).collect();
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
            connections: self.links.iter().map(connection).collect(),
            composites: Vec::new(),
            dependencies: self.needs.iter().map(dependency).collect(),
            order: Vec::new(),
            monitors: Vec::new(),
            reference_models: Vec::new(),
            votings: Vec::new(),
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

fn need(dice: &Dice, slots: &[Slot], ranks: &[u64]) -> Option<Need> {
    let slot = dice.below(slots.len());
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

fn connection(link: &(usize, usize)) -> ConnectionPlan {
    let end = |slot: usize| PortRef { slot: name(slot), port: "p".to_owned() };
    ConnectionPlan {
        kind: PortKind::Data,
        source: end(link.0),
        target: end(link.1),
        validity: Vec::new(),
        on_gone: None,
        location: Location::default(),
    }
}
