//! A slot: the component that fills it, its properties, its executor's period, its secondaries.

use std::path::Path;
use std::sync::Arc;

use super::application::Subcomponent;
use super::assemble::{Assembler, Placed};
use super::component::{ComponentProfile, fits};
use super::document::Profile;
use super::files::Files;
use super::plan::{ComponentPlan, ExecutorPlan, FaultRules, Property, SecondaryPlan, SlotPlan, Trigger};
use super::source::Spot;
use super::suggest;
use super::wire::{Port, describe, ports_of};
use crate::model::limits;

impl Assembler {
    /// Places a slot that `component` fills.
    pub(super) fn slot(
        &mut self,
        files: &mut Files,
        from: &Path,
        slot: &Subcomponent,
        component: &ComponentProfile,
        prefix: &str,
    ) -> Placed {
        let name = format!("{prefix}{}", slot.name.text);
        if self.slots.len() >= limits::SLOTS {
            return self.exhaust(slot, &format!("more than {} slots", limits::SLOTS));
        }
        self.properties += component.plan.properties.len();
        if self.properties > limits::PROPERTIES {
            return self.exhaust(slot, &format!("more than {} properties", limits::PROPERTIES));
        }
        if self.is_declared(&name, &slot.name.spot) {
            return Placed::Broken;
        }
        if component.incomplete {
            self.incomplete.insert(name.clone());
        }
        let component_plan = self.with_period(slot, component);
        let rules = self.rules(files, from, slot, &component_plan, component.incomplete);
        if let Some(spot) = slot.fault_tolerance.as_ref().and_then(|declared| declared.emergency.clone()) {
            self.emergencies.push((name.clone(), spot));
        }
        let secondaries = rules.secondaries.iter().map(|secondary| &*secondary.component);
        let classes: Vec<&ComponentPlan> = std::iter::once(&*component_plan).chain(secondaries).collect();
        if !component.lacks_properties {
            self.check_properties(slot, &classes);
        }
        let plan = SlotPlan {
            application: self.application.clone(),
            properties: overridden(&component_plan, slot),
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
        if found.is_none() && !self.executors_unknown {
            let names: Vec<&str> = self.executors.iter().map(|executor| executor.name.as_str()).collect();
            // Each slot that misspells it is to be corrected; one that is not declared is to be declared once.
            let near = suggest::nearest(&name.text, names.iter().copied());
            if near.is_none() && !self.absent_executors.insert(name.text.clone()) {
                return None;
            }
            let hint = match near {
                Some(near) => format!("did you mean {near}?"),
                None => format!("declare it in the system_profile: <executor name=\"{}\"/>", name.text),
            };
            let message = format!("executor \"{}\" is not declared", name.text);
            self.error(&name.spot, message, &hint);
        }
        found
    }

    /// What a slot says overrides what a class declares, in the primary and in each secondary that declares it too.
    fn check_properties(&mut self, slot: &Subcomponent, classes: &[&ComponentPlan]) {
        let Some(primary) = classes.first() else { return };
        let declared: Vec<&Property> = classes.iter().flat_map(|class| &class.properties).collect();
        for given in &slot.properties {
            let Property { name, type_name, value } = &given.property;
            let Some(known) = declared.iter().find(|property| property.name == *name) else {
                let names: Vec<&str> = declared.iter().map(|property| property.name.as_str()).collect();
                let hint = suggest::hint(name, &names, str::to_owned)
                    .unwrap_or_else(|| format!("{} declares no properties", primary.name));
                self.error(&given.spot, format!("{} has no property \"{name}\"", primary.name), &hint);
                continue;
            };
            if type_name.is_empty() && !fits(&known.type_name, value) {
                let message = format!("property \"{name}\": \"{value}\" is not of type {}", known.type_name);
                self.warning(&given.spot, message, "the component gets the text as it is");
            }
        }
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
            // Rules that a composite hands down name files as the file does that states them.
            let stated = secondary.reference.spot.location().file;
            let from = if stated.as_os_str().is_empty() { from } else { &**stated };
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
            let properties = overridden(&component, slot);
            self.properties += properties.len();
            rules.secondaries.push(SecondaryPlan { component, properties, preload: secondary.preload, location });
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
        let differs = [("lacks", missing), ("has besides", extra)].into_iter().filter(|(_, ports)| !ports.is_empty());
        let differs: Vec<String> = differs.map(|(what, ports)| format!("{what} {}", ports.join(", "))).collect();
        if !differs.is_empty() {
            let hint = format!("a secondary needs the same ports as its primary, {}", primary.name);
            self.error(spot, format!("{} {}", secondary.name, differs.join(", and ")), &hint);
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
}

/// The properties of a class, with the values that the slot gives.
fn overridden(component: &ComponentPlan, slot: &Subcomponent) -> Vec<Property> {
    let mut all = component.properties.clone();
    for property in &mut all {
        let Some(given) = slot.properties.iter().find(|given| given.property.name == property.name) else { continue };
        property.value.clone_from(&given.property.value);
        if !given.property.type_name.is_empty() {
            property.type_name.clone_from(&given.property.type_name);
        }
    }
    all
}
