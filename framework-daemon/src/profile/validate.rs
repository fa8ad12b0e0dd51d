//! What no file can tell alone: dependencies and their cycles, singletons, nodes, actuators, helpers.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;
use std::sync::Arc;

use super::admit;
use super::application::{Assembly, Dependency};
use super::assemble::{Assembler, Placement, Scope};
use super::diagnostic::{Diagnostic, Level};
use super::document::{Document, Profile};
use super::files::Files;
use super::load::system_plan;
use super::plan::{
    ApplicationDependencyPlan, Coverage, DependencyPlan, MonitorPlan, NeededPlan, Plan, SlotPlan, VotingPlan,
};
use super::source::{Spot, Word};
use super::suggest;
use super::system::SystemProfile;
use crate::model::symptom::{Severity, Symptom};

/// Who needs whom, and where that was written.
type Edges = BTreeMap<String, Vec<(String, Spot)>>;

/// Checks everything that spans files and puts the plan together.
pub fn finish(
    dir: &Path,
    system: Option<&Document>,
    (applications, all_read): (&[Arc<Document>], bool),
    assembler: Assembler,
    findings: &mut Vec<Diagnostic>,
) -> Plan {
    let plan = empty_plan(dir, system);
    let mut validator = Validator { assembler, plan, all_read };
    validator.applications(applications);
    validator.singletons();
    validator.placements();
    validator.nodes(applications);
    if let Some(Profile::System(profile)) = system.and_then(|document| document.profile.as_ref()) {
        validator.system(profile, applications);
        validator.require_actuators(profile.has_emergency);
    } else {
        // A file that could not be read may well name them.
        validator.require_actuators(!all_read);
    }
    let Validator { mut assembler, mut plan, .. } = validator;
    plan.slots = std::mem::take(&mut assembler.slots);
    plan.connections = std::mem::take(&mut assembler.connections);
    plan.composites = std::mem::take(&mut assembler.placed_composites);
    plan.reference_models = std::mem::take(&mut assembler.placed_models);
    plan.votings = std::mem::take(&mut assembler.placed_votings).into_iter().map(|(voting, _)| voting).collect();
    plan.composites.sort_by(|one, other| one.name.cmp(&other.name));
    findings.append(&mut assembler.findings);
    // Of what is not whole nothing can be proved.
    if !findings.iter().any(Diagnostic::is_error) && applications.iter().all(|document| document.accepted()) {
        findings.extend(doubts(&plan, &assembler));
    }
    plan
}

fn doubts(plan: &Plan, assembler: &Assembler) -> Vec<Diagnostic> {
    let told = admit::doubts(plan).into_iter().filter_map(|doubt| {
        let spot = assembler.declared_at(&doubt.slot)?;
        Some(spot.diagnostic(Level::Warning, doubt.message).with_hint(doubt.hint))
    });
    told.collect()
}

/// Checks the names inside an application or a composite whose references are not followed.
#[must_use]
pub fn names_alone(document: &Arc<Document>) -> Vec<Diagnostic> {
    let mut assembler = Assembler::alone();
    assembler.application(&mut Files::default(), document);
    let mut validator = Validator { assembler, plan: empty_plan(Path::new(""), None), all_read: true };
    validator.placements();
    validator.assembler.findings
}

fn empty_plan(dir: &Path, system: Option<&Document>) -> Plan {
    Plan {
        root: dir.to_path_buf(),
        system: system_plan(system),
        applications: Vec::new(),
        slots: Vec::new(),
        connections: Vec::new(),
        composites: Vec::new(),
        dependencies: Vec::new(),
        order: Vec::new(),
        monitors: Vec::new(),
        reference_models: Vec::new(),
        votings: Vec::new(),
    }
}

struct Validator {
    assembler: Assembler,
    plan: Plan,
    /// True where every file of the directory could be read: what is in none of them is missing.
    all_read: bool,
}

impl Validator {
    fn applications(&mut self, applications: &[Arc<Document>]) {
        self.all_read &= applications.iter().all(|document| name_of(document).is_some());
        for name in applications.iter().filter_map(|document| name_of(document)) {
            if self.plan.applications.contains(&name.text) {
                let message = format!("application \"{}\" is already in this directory", name.text);
                self.assembler.error(&name.spot, message, "give each application a name of its own");
                continue;
            }
            self.plan.applications.push(name.text.clone());
        }
    }

    /// A singleton keeps its state in the library: two instances would share it.
    fn singletons(&mut self) {
        let mut users: HashMap<&str, &str> = HashMap::new();
        let mut found = Vec::new();
        for slot in self.assembler.slots.iter().filter(|slot| slot.component.execution.singleton) {
            if let Some(first) = users.get(slot.component.name.as_str()) {
                let message = format!("{} is a singleton and already fills the slot \"{first}\"", slot.component.name);
                found.push((slot.name.clone(), message));
            } else {
                users.insert(&slot.component.name, &slot.name);
            }
        }
        for (slot, message) in found {
            if let Some(spot) = self.assembler.declared_at(&slot) {
                let hint = "use the class once, or say <creation_type>multiple</creation_type> in its profile";
                self.assembler.error(&spot, message, hint);
            }
        }
    }

    /// The rules of every assembly, resolved among its own names.
    fn placements(&mut self) {
        let mut edges = Edges::new();
        let mut order = Edges::new();
        for placement in std::mem::take(&mut self.assembler.placements) {
            let Placement { document, scope, prefix } = placement;
            let (Some(Profile::Application(assembly)) | Some(Profile::Composite(assembly))) = &document.profile else {
                continue;
            };
            for dependency in &assembly.dependencies {
                self.dependency(dependency, &scope, &prefix, &mut edges);
            }
            self.refuse_twins(&assembly.dependencies);
            self.order(assembly, &scope, &mut order);
            self.helpers(assembly, &scope);
        }
        self.votings(&mut edges);
        self.refuse_cycles(&edges, "dependencies form a circle");
        self.refuse_cycles(&order, "the run order forms a circle");
    }

    fn dependency(&mut self, dependency: &Dependency, scope: &Scope, prefix: &str, edges: &mut Edges) {
        let dependents = self.assembler.slots_called(&dependency.dependent, scope);
        let mut on = Vec::new();
        for word in &dependency.on {
            let slots = self.assembler.needed_called(word, scope, prefix);
            for slot in &slots {
                for dependent in &dependents {
                    edges.entry(dependent.clone()).or_default().push((slot.clone(), word.spot.clone()));
                }
            }
            on.push(NeededPlan { name: word.text.clone(), slots });
        }
        for slot in dependents {
            let require = dependency.require.unwrap_or(on.len());
            self.plan.dependencies.push(DependencyPlan {
                slot,
                on: on.clone(),
                require,
                location: dependency.spot.location(),
            });
        }
    }

    /// A voter needs those who vote.
    fn votings(&self, edges: &mut Edges) {
        for (voting, spot) in &self.assembler.placed_votings {
            if let Some(name) = &voting.name {
                let inputs = voting.inputs.iter().map(|input| (input.slot.clone(), spot.clone()));
                edges.entry(name.clone()).or_default().extend(inputs);
            }
        }
    }

    fn order(&mut self, assembly: &Assembly, scope: &Scope, edges: &mut Edges) {
        for (source, target) in &assembly.order {
            let (sources, targets) =
                (self.assembler.slots_called(source, scope), self.assembler.slots_called(target, scope));
            for source in &sources {
                for later in &targets {
                    edges.entry(source.clone()).or_default().push((later.clone(), target.spot.clone()));
                    self.plan.order.push((source.clone(), later.clone()));
                }
            }
        }
    }

    fn helpers(&mut self, assembly: &Assembly, scope: &Scope) {
        for monitor in &assembly.monitors {
            let Some(port) = self.assembler.data_port(&monitor.port, scope) else { continue };
            if let Some(first) = self.plan.monitors.iter().find(|other| other.port == port.end) {
                let message = format!("this port is already watched in line {}", first.location.line);
                self.assembler.error(&monitor.spot, message, "put all its rules into one <monitor>");
                continue;
            }
            self.plan.monitors.push(MonitorPlan {
                port: port.end,
                validity: monitor.validity.clone(),
                max_age: monitor.max_age,
                location: monitor.port.component.spot.location(),
            });
        }
    }

    /// Without declared nodes `node_id` is what OPRoS left there; with them it must name one.
    fn nodes(&mut self, applications: &[Arc<Document>]) {
        if self.plan.system.nodes.is_empty() {
            return;
        }
        let names: Vec<String> = self.plan.system.nodes.iter().map(|node| node.name.clone()).collect();
        for document in applications {
            let Some(Profile::Application(assembly)) = &document.profile else { continue };
            for slot in assembly.subcomponents.iter().filter(|slot| !slot.node.text.is_empty()) {
                if names.contains(&slot.node.text) {
                    continue;
                }
                let known: Vec<&str> = names.iter().map(String::as_str).collect();
                let hint = suggest::hint(&slot.node.text, &known, str::to_owned)
                    .unwrap_or_else(|| "declare it in the system_profile: <node name=\"...\"/>".to_owned());
                let message = format!("node \"{}\" is not declared", slot.node.text);
                self.assembler.error(&slot.node.spot, message, &hint);
            }
        }
    }

    fn system(&mut self, profile: &SystemProfile, applications: &[Arc<Document>]) {
        let all_accepted = self.all_read && applications.iter().all(|document| document.accepted());
        for actuator in &profile.actuators {
            if self.assembler.slots.iter().any(|slot| slot.name == actuator.text) {
                self.plan.system.emergency.push(actuator.text.clone());
            } else if all_accepted && !self.assembler.may_be_missing(&actuator.text) {
                // A slot of a broken application is not missing, only not known.
                self.no_actuator(actuator);
            }
        }
        let mut edges = Edges::new();
        for dependency in &profile.application_dependencies {
            self.application_dependency(dependency, &mut edges);
        }
        self.refuse_twins(&profile.application_dependencies);
        self.refuse_cycles(&edges, "dependencies of applications form a circle");
    }

    fn no_actuator(&mut self, actuator: &Word) {
        let Word { text: name, spot } = actuator;
        let assembler = &mut self.assembler;
        if let Some(composite) = assembler.placed_composites.iter().find(|composite| composite.name == *name) {
            let list = suggest::listed(composite.slots.iter().map(String::as_str));
            let message = format!("\"{name}\" is a composite, no slot");
            return assembler.error(spot, message, &format!("name those slots in it that drive something: {list}"));
        }
        if assembler.placed_votings.iter().any(|(voting, _)| voting.name.as_ref() == Some(name)) {
            let message = format!("\"{name}\" is a voter, no slot");
            return assembler.error(spot, message, "name a slot that drives something: a voter has nothing to stop");
        }
        let names: Vec<&str> = assembler.slots.iter().map(|slot| slot.name.as_str()).collect();
        let is_list = name.split([' ', ',']).all(|part| part.is_empty() || names.contains(&part));
        let hint = match is_list {
            true => "an <actuator> names one slot: write one for each".to_owned(),
            false => suggest::hint(name, &names, str::to_owned).unwrap_or_else(|| "no slot is declared".to_owned()),
        };
        assembler.error(spot, format!("no slot is called \"{name}\""), &hint);
    }

    /// An emergency stop that nobody gets is a mistake that only shows when the robot needs it. It is one mistake, whoever may
    /// ask for it.
    fn require_actuators(&mut self, named: bool) {
        if named || !self.plan.system.emergency.is_empty() {
            return;
        }
        let reaches = |slot: &&SlotPlan| {
            let mut symptoms = Symptom::ALL.into_iter();
            slot.rules.coverage == Coverage::System
                || symptoms.any(|symptom| slot.rules.severity.get(symptom) == Severity::Emergency)
        };
        let slots = self.assembler.slots.iter().filter(reaches).map(|slot| (slot.name.clone(), None));
        let raises = |(voting, _): &&(VotingPlan, Spot)| voting.severity == Severity::Emergency;
        let named = |(voting, spot): &(VotingPlan, Spot)| {
            (voting.name.clone().unwrap_or_else(|| "voting".to_owned()), Some(spot.clone()))
        };
        let mut found = slots.chain(self.assembler.placed_votings.iter().filter(raises).map(named));
        let Some((first, spot)) = found.next() else { return };
        let others = match found.count() {
            0 => String::new(),
            1 => " (and of another slot)".to_owned(),
            more => format!(" (and of {more} other slots)"),
        };
        let mut said = self.assembler.emergencies.iter().filter(|(slot, _)| *slot == first);
        let spot =
            spot.or_else(|| said.next().map(|(_, spot)| spot.clone())).or_else(|| self.assembler.declared_at(&first));
        let Some(spot) = spot else { return };
        let message =
            format!("a fault of \"{first}\"{others} brings the robot to its safe state, but no actuator is named");
        let hint = "add <emergency><actuator component=\"motors\"/></emergency> to the system_profile";
        self.assembler.error(&spot, message, hint);
    }

    fn application_dependency(&mut self, dependency: &Dependency, edges: &mut Edges) {
        if dependency.dependent.text.is_empty() {
            return;
        }
        for word in dependency.on.iter().chain([&dependency.dependent]) {
            // An application that could not be read is not missing, only not known.
            if self.all_read && !self.plan.applications.contains(&word.text) {
                let names: Vec<&str> = self.plan.applications.iter().map(String::as_str).collect();
                let hint = suggest::hint(&word.text, &names, str::to_owned)
                    .unwrap_or_else(|| "the directory holds no application".to_owned());
                self.assembler.error(&word.spot, format!("no application is called \"{}\"", word.text), &hint);
            }
        }
        let dependent = &dependency.dependent.text;
        for word in &dependency.on {
            edges.entry(dependent.clone()).or_default().push((word.text.clone(), word.spot.clone()));
        }
        self.plan.system.dependencies.push(ApplicationDependencyPlan {
            application: dependent.clone(),
            on: dependency.on.iter().map(|word| word.text.clone()).collect(),
            require: dependency.require.unwrap_or(dependency.on.len()),
            location: dependency.spot.location(),
        });
    }

    /// Two dependencies of one on the same others: of the two numbers only the greater would count.
    fn refuse_twins(&mut self, dependencies: &[Dependency]) {
        let mut seen: HashMap<(&str, BTreeSet<&str>), u32> = HashMap::new();
        for dependency in dependencies.iter().filter(|one| !one.dependent.text.is_empty() && !one.on.is_empty()) {
            let on = dependency.on.iter().map(|word| word.text.as_str()).collect();
            let line = dependency.spot.location().line;
            if let Some(first) = seen.insert((&dependency.dependent.text, on), line) {
                let message = format!("\"{}\" already depends on these in line {first}", dependency.dependent.text);
                self.assembler.error(&dependency.spot, message, "remove one of them");
            }
        }
    }

    fn refuse_cycles(&mut self, edges: &Edges, what: &str) {
        for (path, spot) in cycles(edges) {
            let message = format!("{what}: {}", path.join(" -> "));
            self.assembler.findings.push(spot.diagnostic(Level::Error, message).with_hint("remove one of these steps"));
        }
    }
}

fn name_of(document: &Document) -> Option<&Word> {
    match &document.profile {
        Some(Profile::Application(assembly)) if !assembly.name.text.is_empty() => Some(&assembly.name),
        _ => None,
    }
}

/// Each circle once, as the path from its first member back to it, with the edge that closes it.
///
/// Depth first with a stack of its own: a chain of ten thousand dependencies must not end the thread's stack.
fn cycles(edges: &Edges) -> Vec<(Vec<String>, Spot)> {
    let mut done: HashMap<&str, bool> = HashMap::new();
    let mut found = Vec::new();
    for start in edges.keys() {
        if done.contains_key(start.as_str()) {
            continue;
        }
        let mut path: Vec<(&str, usize)> = vec![(start, 0)];
        done.insert(start, false);
        while let Some((node, next)) = path.last_mut() {
            let Some((target, spot)) = edges.get(*node).and_then(|targets| targets.get(*next)) else {
                done.insert(node, true);
                path.pop();
                continue;
            };
            *next += 1;
            match done.get(target.as_str()) {
                Some(true) => {}
                Some(false) => {
                    let from = path.iter().position(|(node, _)| *node == target).unwrap_or(0);
                    let names = path.iter().skip(from).map(|(node, _)| (*node).to_owned());
                    found.push((names.chain([target.clone()]).collect(), spot.clone()));
                }
                None => {
                    done.insert(target, false);
                    path.push((target, 0));
                }
            }
        }
    }
    found
}
