//! Applications to slots and connections: references followed, composites flattened, ends of connections resolved.
//!
//! Composites are flattened here and not at run time: a slot `outer.inner` is a slot like any other, so that nothing to
//! the right knows composites at all.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::application::{Assembly, Subcomponent};
use super::diagnostic::{Diagnostic, Level};
use super::document::{Document, Profile};
use super::files::{self, Files};
use super::plan::{
    CompositePlan, ConnectionPlan, ExecutorPlan, Location, PortKind, PortRef, ReferenceModelPlan, SlotPlan, VotingPlan,
};
use super::source::{Spot, Word};
use super::wire::Port;
use crate::model::limits;
use crate::model::names::FAULT_MANAGER;

/// What a name in an assembly stands for.
#[derive(Debug)]
pub enum Placed {
    /// A slot, by index.
    Slot(usize),
    /// A composite.
    Composite(Inside),
    /// A voter: its output.
    Voter(Box<Port>),
    /// Something that could not be read; reported where it is declared.
    Broken,
}

/// What shows of a composite, and what is in it.
#[derive(Debug)]
pub struct Inside {
    /// Its exported ports.
    pub ports: Vec<Port>,
    /// The slots in it, by index.
    pub slots: Vec<usize>,
    /// True where a port is not exported because of an error: that it is missing is no news.
    pub incomplete: bool,
}

/// The names of one assembly.
#[derive(Debug, Default)]
pub struct Scope {
    names: BTreeMap<String, Placed>,
    /// True where a name could not be read: one that is not here may be meant by it, which is reported.
    pub incomplete: bool,
}

impl Scope {
    /// What a name stands for.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Placed> {
        self.names.get(name)
    }

    /// True where something has that name.
    #[must_use]
    pub fn contains_key(&self, name: &str) -> bool {
        self.names.contains_key(name)
    }

    /// Gives something a name.
    pub fn insert(&mut self, name: String, placed: Placed) {
        self.names.insert(name, placed);
    }

    /// All names.
    pub fn keys(&self) -> impl Iterator<Item = &String> {
        self.names.keys()
    }
}

/// One assembly, placed: what `validate` resolves its rules with.
#[derive(Debug)]
pub struct Placement {
    /// The document that holds the assembly.
    pub document: Arc<Document>,
    /// Its names.
    pub scope: Scope,
    /// What the names of its slots begin with.
    pub prefix: String,
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
    /// True where one of them could not be read: another that is missing is no news.
    pub executors_unknown: bool,
    /// Slots whose fault brings the robot to its safe state, and where that is said.
    pub(super) emergencies: Vec<(String, Spot)>,
    /// What was found.
    pub findings: Vec<Diagnostic>,
    /// Slots of whose component a port could not be read: another port that is missing is no news.
    pub(super) incomplete: HashSet<String>,
    /// Slots and composites that could not be placed: that they are missing is no news.
    pub(super) broken: HashSet<String>,
    /// True where a slot of any assembly has no name that could be read.
    pub(super) incomplete_slots: bool,
    /// Files of the components that fill a slot or stand by.
    pub used: HashSet<PathBuf>,
    /// The line of each connection.
    pub(super) linked: HashMap<(PortKind, PortRef, PortRef), u32>,
    /// Required services that have their provider.
    pub(super) called: HashSet<PortRef>,
    /// Where each slot was declared first.
    pub(super) declared: HashMap<String, Spot>,
    /// True where a limit of the whole plan was met: ten composites of ten composites of ... would never end.
    pub(super) exhausted: bool,
    /// How many composites are placed.
    composites: usize,
    /// Those that are placed whole, inner ones first.
    pub placed_composites: Vec<CompositePlan>,
    /// Slots that are compared with models.
    pub(super) placed_models: Vec<ReferenceModelPlan>,
    /// Outputs that are voted over.
    pub(super) placed_votings: Vec<(VotingPlan, Spot)>,
    /// How many properties all slots have.
    pub(super) properties: usize,
    /// True where references are not followed.
    alone: bool,
    pub(super) application: String,
    /// Those that are placed.
    applications: HashSet<String>,
    /// Executors whose absence is told.
    pub(super) absent_executors: HashSet<String>,
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
        // A second of that name is refused as a whole: each of its slots would be there twice.
        if !self.applications.insert(assembly.name.text.clone()) && !assembly.name.text.is_empty() {
            return;
        }
        self.application.clone_from(&assembly.name.text);
        self.place(files, document, assembly, "");
    }

    /// Places an assembly under `prefix` and returns its exported ports and its slots.
    fn place(&mut self, files: &mut Files, document: &Arc<Document>, assembly: &Assembly, prefix: &str) -> Inside {
        let first_slot = self.slots.len();
        let mut scope = Scope { incomplete: assembly.incomplete, ..Scope::default() };
        let mut lines: HashMap<&str, u32> = HashMap::new();
        for subcomponent in &assembly.subcomponents {
            let name = &subcomponent.name;
            if let Some(line) = lines.get(name.text.as_str()) {
                let message = format!("slot \"{}\" is already declared in line {line}", name.text);
                self.error(&name.spot, message, "give each subcomponent a name of its own");
                // Which one has the wrong name, and what its own would be, nobody knows.
                scope.incomplete = true;
                self.incomplete_slots = true;
                continue;
            }
            if name.text == FAULT_MANAGER {
                let message = format!("\"{FAULT_MANAGER}\" is the fault manager's own name");
                self.error(&name.spot, message, "give the slot another one");
                scope.incomplete = true;
                self.incomplete_slots = true;
            }
            lines.insert(&name.text, name.spot.location().line);
            let placed = self.subcomponent(files, &document.path, subcomponent, prefix);
            if matches!(placed, Placed::Broken) {
                self.broken.insert(format!("{prefix}{}", name.text));
            }
            scope.insert(name.text.clone(), placed);
        }
        self.votings(assembly, prefix, &mut scope);
        for connection in &assembly.connections {
            self.connection(connection, &scope);
        }
        self.reference_models(assembly, &scope);
        self.incomplete_slots |= assembly.incomplete;
        let (ports, all) = self.exports(assembly, &scope);
        let incomplete = assembly.incomplete || !all;
        self.placements.push(Placement { document: Arc::clone(document), scope, prefix: prefix.to_owned() });
        Inside { ports, slots: (first_slot..self.slots.len()).collect(), incomplete }
    }

    fn subcomponent(&mut self, files: &mut Files, from: &Path, slot: &Subcomponent, prefix: &str) -> Placed {
        if self.exhausted || slot.reference.text.is_empty() {
            return Placed::Broken;
        }
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

    /// The document that a reference means.
    pub(super) fn follow(
        &mut self,
        files: &mut Files,
        from: &Path,
        reference: &Word,
    ) -> Option<(usize, Arc<Document>)> {
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
        self.composites += 1;
        if self.composites > limits::COMPOSITES {
            return self.exhaust(slot, &format!("more than {} composites", limits::COMPOSITES));
        }
        let name = format!("{prefix}{}", slot.name.text);
        if self.is_declared(&name, &slot.name.spot) {
            return Placed::Broken;
        }
        let inner = self.inherit(slot, inner);
        self.open.push((index, inner.name.text.clone()));
        let inside = self.place(files, document, &inner, &format!("{name}."));
        self.open.pop();
        self.placed_composites.push(CompositePlan {
            name,
            profile: inner.name.text.clone(),
            application: self.application.clone(),
            slots: inside
                .slots
                .iter()
                .filter_map(|index| self.slots.get(*index))
                .map(|slot| slot.name.clone())
                .collect(),
            exports: inside.ports.iter().map(|port| (port.name.clone(), port.end.clone())).collect(),
        });
        Placed::Composite(inside)
    }

    /// Reports a limit of the whole plan, once.
    pub(super) fn exhaust(&mut self, slot: &Subcomponent, message: &str) -> Placed {
        self.exhausted = true;
        self.error(&slot.name.spot, format!("{message} in one directory"), "split the system into several directories");
        Placed::Broken
    }

    /// Declares a slot or a composite; true, and reported, where there is one of that name.
    pub(super) fn is_declared(&mut self, name: &str, spot: &Spot) -> bool {
        let Some(first) = self.declared.get(name) else {
            self.declared.insert(name.to_owned(), spot.clone());
            return false;
        };
        let Location { file, line, .. } = first.location();
        let message = format!("slot \"{name}\" is already declared in {}:{line}", file.display());
        self.error(spot, message, "slots of all applications share one space of names: rename one");
        true
    }

    /// True where a slot of that name may only be missing because of an error that is told elsewhere.
    #[must_use]
    pub fn may_be_missing(&self, slot: &str) -> bool {
        let lies_in = |broken: &String| slot.strip_prefix(broken.as_str()).is_some_and(|rest| rest.starts_with('.'));
        self.exhausted || self.incomplete_slots || self.broken.contains(slot) || self.broken.iter().any(lies_in)
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
