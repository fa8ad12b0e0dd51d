//! Applications to slots and connections: references followed, composites flattened, ends of connections resolved.
//!
//! Composites are flattened here and not at run time: a slot `outer.inner` is a slot like any other, so that nothing to
//! the right knows composites at all.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::application::{Assembly, Subcomponent};
use super::component::ComponentProfile;
use super::diagnostic::{Diagnostic, Level};
use super::document::{Document, Profile};
use super::files::{self, Files};
use super::plan::{
    ComponentPlan, ConnectionPlan, ExecutorPlan, FaultRules, Location, PortKind, PortRef, Property, SecondaryPlan,
    SlotPlan, Trigger,
};
use super::source::{Spot, Word};
use super::suggest;
use super::wire::{Port, describe, ports_of};
use crate::model::limits;

/// What a name in an assembly stands for.
#[derive(Debug)]
pub enum Placed {
    /// A slot, by index.
    Slot(usize),
    /// A composite: its exported ports and the slots in it.
    Composite(Vec<Port>, Vec<usize>),
    /// Something that could not be read; reported where it is declared.
    Broken,
}

/// The names of one assembly.
pub type Scope = BTreeMap<String, Placed>;

/// One assembly, placed: what `validate` resolves its rules with.
#[derive(Debug)]
pub struct Placement {
    /// The document that holds the assembly.
    pub document: Arc<Document>,
    /// Its names.
    pub scope: Scope,
}

/// Everything that is put together so far.
#[derive(Debug, Default)]
pub struct Assembler {
    /// The slots.
    pub slots: Vec<SlotPlan>,
    /// The connections.
    pub connections: Vec<ConnectionPlan>,
    /// The assemblies, outermost last.
    pub placements: Vec<Placement>,
    /// Declared executors.
    pub executors: Vec<ExecutorPlan>,
    /// What was found.
    pub findings: Vec<Diagnostic>,
    /// Slots of whose component a port could not be read: another port that is missing is no news.
    pub(super) incomplete: HashSet<String>,
    /// Files of the components that fill a slot or stand by.
    pub used: HashSet<PathBuf>,
    /// The line of each connection.
    pub(super) linked: HashMap<(PortKind, PortRef, PortRef), u32>,
    /// Required services that have their provider.
    pub(super) called: HashSet<PortRef>,
    /// Where each slot was declared first.
    declared: HashMap<String, Spot>,
    /// True where references are not followed.
    alone: bool,
    application: String,
    /// Composites that are being flattened, outermost first.
    open: Vec<(usize, String)>,
}

impl Assembler {
    /// One that does not follow references: for a file that is checked alone.
    #[must_use]
    pub fn alone() -> Self {
        Self { alone: true, ..Self::default() }
    }

    /// Places the application in `document`, or the composite, where it is checked alone.
    pub fn application(&mut self, files: &mut Files, document: &Arc<Document>) {
        let (Some(Profile::Application(assembly)) | Some(Profile::Composite(assembly))) = &document.profile else {
            return;
        };
        self.application.clone_from(&assembly.name.text);
        self.place(files, document, assembly, "");
    }

    /// Places an assembly under `prefix` and returns its exported ports and its slots.
    fn place(
        &mut self,
        files: &mut Files,
        document: &Arc<Document>,
        assembly: &Assembly,
        prefix: &str,
    ) -> (Vec<Port>, Vec<usize>) {
        let first_slot = self.slots.len();
        let mut scope = Scope::new();
        let mut lines: HashMap<&str, u32> = HashMap::new();
        for subcomponent in &assembly.subcomponents {
            let name = &subcomponent.name;
            if let Some(line) = lines.get(name.text.as_str()) {
                let message = format!("slot \"{}\" is already declared in line {line}", name.text);
                self.error(&name.spot, message, "give each subcomponent a name of its own");
                continue;
            }
            lines.insert(&name.text, name.spot.location().line);
            let placed = self.subcomponent(files, &document.path, subcomponent, prefix);
            scope.insert(name.text.clone(), placed);
        }
        for connection in &assembly.connections {
            self.connection(connection, &scope);
        }
        let exports = self.exports(assembly, &scope);
        self.placements.push(Placement { document: Arc::clone(document), scope });
        (exports, (first_slot..self.slots.len()).collect())
    }

    fn subcomponent(&mut self, files: &mut Files, from: &Path, slot: &Subcomponent, prefix: &str) -> Placed {
        let Some((index, document)) = self.follow(files, from, &slot.reference) else { return Placed::Broken };
        match &document.profile {
            Some(Profile::Component(component)) => self.slot(files, from, slot, component, prefix),
            Some(Profile::Composite(inner)) => self.composite(files, index, &document, slot, inner, prefix),
            Some(_) => {
                let message = format!("{} is a <{}>", document.path.display(), document.root);
                let hint = "a subcomponent refers to a <component_profile> or a <composite_component_profile>";
                self.error(&slot.reference.spot, message, hint);
                Placed::Broken
            }
            None => Placed::Broken,
        }
    }

    fn follow(&mut self, files: &mut Files, from: &Path, reference: &Word) -> Option<(usize, Arc<Document>)> {
        if self.alone {
            return None;
        }
        let path = match files::resolve(from, &self.application, reference) {
            Ok(path) => path,
            Err(finding) => {
                self.findings.push(*finding);
                return None;
            }
        };
        let opened = files.open(&path);
        if opened.is_none() {
            let message = format!("more than {} profile files", limits::PROFILE_FILES);
            self.error(&reference.spot, message, "split the system into several directories");
        }
        opened
    }

    fn composite(
        &mut self,
        files: &mut Files,
        index: usize,
        document: &Arc<Document>,
        slot: &Subcomponent,
        inner: &Assembly,
        prefix: &str,
    ) -> Placed {
        if let Some(at) = self.open.iter().position(|(open, _)| *open == index) {
            let names = self.open.iter().skip(at).map(|(_, name)| name.as_str()).chain([inner.name.text.as_str()]);
            let path: Vec<&str> = names.collect();
            let message = format!("composite \"{}\" holds itself: {}", inner.name.text, path.join(" -> "));
            self.error(&slot.reference.spot, message, "a composite may hold others, but never itself");
            return Placed::Broken;
        }
        if self.open.len() >= limits::COMPOSITE_DEPTH {
            let message = format!("composites nest deeper than {}", limits::COMPOSITE_DEPTH);
            self.error(&slot.reference.spot, message, "flatten some of them");
            return Placed::Broken;
        }
        self.warn_of_ignored_rules(slot);
        self.open.push((index, inner.name.text.clone()));
        let (exports, slots) = self.place(files, document, inner, &format!("{prefix}{}.", slot.name.text));
        self.open.pop();
        Placed::Composite(exports, slots)
    }

    /// A composite is no slot: what only a slot can have would be lost without a word.
    fn warn_of_ignored_rules(&mut self, slot: &Subcomponent) {
        const WAY_OUT: &str = "say it of the subcomponents inside the composite";
        if let Some(rules) = &slot.fault_tolerance {
            self.error(&rules.spot, "<fault_tolerance> of a composite is not possible", WAY_OUT);
        }
        if let Some(executor) = &slot.executor {
            self.error(&executor.spot, "<executor> of a composite is not possible", WAY_OUT);
        }
        if let Some(property) = slot.properties.first() {
            self.error(&property.spot, "properties of a composite are not possible", WAY_OUT);
        }
    }

    fn slot(
        &mut self,
        files: &mut Files,
        from: &Path,
        slot: &Subcomponent,
        component: &ComponentProfile,
        prefix: &str,
    ) -> Placed {
        let name = format!("{prefix}{}", slot.name.text);
        if self.slots.len() >= limits::SLOTS {
            self.error(&slot.name.spot, format!("more than {} slots", limits::SLOTS), "split the system");
            return Placed::Broken;
        }
        if let Some(first) = self.declared.get(&name) {
            let Location { file, line, .. } = first.location();
            let message = format!("slot \"{name}\" is already declared in {}:{line}", file.display());
            self.error(&slot.name.spot, message, "slots of all applications share one space of names: rename one");
            return Placed::Broken;
        }
        self.declared.insert(name.clone(), slot.name.spot.clone());
        if component.incomplete {
            self.incomplete.insert(name.clone());
        }
        let component_plan = self.with_period(slot, component);
        let rules = self.rules(files, from, slot, &component_plan, component.incomplete);
        let plan = SlotPlan {
            application: self.application.clone(),
            properties: self.properties(slot, &component_plan),
            component: component_plan,
            executor: slot.executor.as_ref().map(|executor| executor.text.clone()),
            node: Some(slot.node.text.clone()).filter(|node| !node.is_empty()),
            rules,
            location: slot.name.spot.location(),
            name,
        };
        self.slots.push(plan);
        Placed::Slot(self.slots.len() - 1)
    }

    /// The component, with its executor's period where it states none of its own.
    fn with_period(&mut self, slot: &Subcomponent, component: &ComponentProfile) -> Arc<ComponentPlan> {
        self.used.insert(component.plan.location.file.to_path_buf());
        let executor = self.executor_of(slot);
        let Some(missing) = &component.missing_period else { return Arc::clone(&component.plan) };
        let Some(period) = executor.and_then(|executor| executor.period) else {
            self.findings.push((**missing).clone());
            return Arc::clone(&component.plan);
        };
        let mut plan = (*component.plan).clone();
        plan.execution.trigger = Trigger::Periodic(period);
        Arc::new(plan)
    }

    fn executor_of(&mut self, slot: &Subcomponent) -> Option<ExecutorPlan> {
        let name = slot.executor.as_ref()?;
        let found = self.executors.iter().find(|executor| executor.name == name.text).cloned();
        if found.is_none() {
            let names: Vec<&str> = self.executors.iter().map(|executor| executor.name.as_str()).collect();
            let hint = suggest::hint(&name.text, &names, str::to_owned)
                .unwrap_or_else(|| "declare it in the system_profile: <executor name=\"...\"/>".to_owned());
            let message = format!("executor \"{}\" is not declared", name.text);
            self.error(&name.spot, message, &hint);
        }
        found
    }

    fn properties(&mut self, slot: &Subcomponent, component: &ComponentPlan) -> Vec<Property> {
        let mut all = component.properties.clone();
        for given in &slot.properties {
            match all.iter_mut().find(|property| property.name == given.property.name) {
                Some(property) => {
                    if given.property.type_name.is_empty() {
                        property.value.clone_from(&given.property.value);
                    } else {
                        *property = given.property.clone();
                    }
                }
                None => {
                    let names: Vec<&str> = component.properties.iter().map(|property| property.name.as_str()).collect();
                    let hint = suggest::hint(&given.property.name, &names, str::to_owned)
                        .unwrap_or_else(|| format!("{} declares no properties", component.name));
                    let message = format!("{} has no property \"{}\"", component.name, given.property.name);
                    self.error(&given.spot, message, &hint);
                }
            }
        }
        all
    }

    fn rules(
        &mut self,
        files: &mut Files,
        from: &Path,
        slot: &Subcomponent,
        primary: &ComponentPlan,
        primary_incomplete: bool,
    ) -> FaultRules {
        let Some(declared) = &slot.fault_tolerance else { return FaultRules::default() };
        let mut rules = declared.rules.clone();
        for secondary in &declared.references {
            let Some((_, document)) = self.follow(files, from, &secondary.reference) else { continue };
            let Some(Profile::Component(component)) = &document.profile else {
                if document.profile.is_some() {
                    let message = format!("{} is a <{}>", document.path.display(), document.root);
                    self.error(&secondary.reference.spot, message, "a secondary is a <component_profile>");
                }
                continue;
            };
            if !primary_incomplete && !component.incomplete {
                self.compare_ports(primary, &component.plan, &secondary.reference.spot);
            }
            let component = self.with_period(slot, component);
            let location = secondary.reference.spot.location();
            rules.secondaries.push(SecondaryPlan { component, preload: secondary.preload, location });
        }
        rules
    }

    /// A secondary takes over the slot's ports as they are wired.
    fn compare_ports(&mut self, primary: &ComponentPlan, secondary: &ComponentPlan, spot: &Spot) {
        if primary.name == secondary.name {
            let message = format!("the secondary is the same class as the primary, {}", primary.name);
            self.warning(spot, message, "the same fault will hit it again; a recovery block needs another algorithm");
            return;
        }
        let (ours, theirs) = (ports_of("", primary), ports_of("", secondary));
        let same = |a: &Port, b: &Port| a.name == b.name && a.kind == b.kind && a.is_source == b.is_source;
        let lacks = |have: &[Port], want: &[Port]| -> Vec<String> {
            want.iter().filter(|port| !have.iter().any(|other| same(port, other))).map(describe).collect()
        };
        let (missing, extra) = (lacks(&theirs, &ours), lacks(&ours, &theirs));
        for (what, ports) in [("lacks", missing), ("has besides", extra)] {
            if !ports.is_empty() {
                let message = format!("{} {what} {}", secondary.name, ports.join(", "));
                let hint = format!("a secondary needs the same ports as its primary, {}", primary.name);
                self.error(spot, message, &hint);
            }
        }
        for port in &ours {
            if let Some(other) = theirs.iter().find(|other| same(port, other) && other.type_name != port.type_name) {
                let message = format!(
                    "port \"{}\" is of type {} in {}, of type {} in {}",
                    port.name, port.type_name, primary.name, other.type_name, secondary.name
                );
                self.warning(spot, message, "the layouts of both are compared when the plugins are loaded");
            }
        }
    }

    /// Where a slot was declared.
    #[must_use]
    pub fn declared_at(&self, slot: &str) -> Option<Spot> {
        self.declared.get(slot).cloned()
    }

    /// Reports an error with its way out.
    pub fn error(&mut self, spot: &Spot, message: impl Into<String>, hint: &str) {
        self.findings.push(spot.diagnostic(Level::Error, message).with_hint(hint));
    }

    /// Reports a warning with its way out.
    pub fn warning(&mut self, spot: &Spot, message: impl Into<String>, hint: &str) {
        self.findings.push(spot.diagnostic(Level::Warning, message).with_hint(hint));
    }
}
