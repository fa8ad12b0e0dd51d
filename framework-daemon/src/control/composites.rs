//! Composites as they are shown. A system that runs has only slots; what a composite is called, and which of the ports in it
//! it shows, the plan tells.

use std::borrow::Cow;

use serde_json::{Value, json};

use super::directory::{Directory, Wires};
use super::interface::PortName;
use super::{helpers, views};
use crate::profile::plan::{CompositePlan, PortRef};

/// All composites, each as the slots in it are together.
pub(super) fn all(directory: &Directory) -> Vec<Value> {
    directory.composites().iter().map(|composite| shown(directory, composite)).collect()
}

/// All that is known of a composite; `None`: there is none of that name.
pub(super) fn details(directory: &Directory, name: &str) -> Option<Value> {
    let composite = find(directory, name)?;
    let mut fields = shown(directory, composite);
    fields["ports"] = ports(directory, composite, &directory.wires()).into();
    Some(fields)
}

/// The ports that a composite shows; `None`: there is none of that name.
pub(super) fn ports_of(directory: &Directory, name: &str) -> Option<Vec<Value>> {
    Some(ports(directory, find(directory, name)?, &directory.wires()))
}

/// The ports that all composites show.
pub(super) fn all_ports(directory: &Directory, wires: &Wires) -> Vec<Value> {
    directory.composites().iter().flat_map(|composite| ports(directory, composite, wires)).collect()
}

/// The slot's port that a name stands for: of several that a composite shows by one name, the first.
pub(super) fn inner<'a>(directory: &Directory, name: &'a PortName) -> Cow<'a, PortName> {
    let shown = find(directory, &name.slot).and_then(|composite| {
        let export = composite.exports.iter().find(|(port, _)| *port == name.port)?;
        let PortRef { slot, port } = &export.1;
        Some(PortName { slot: slot.clone(), port: port.clone() })
    });
    shown.map_or(Cow::Borrowed(name), Cow::Owned)
}

fn find<'a>(directory: &'a Directory, name: &str) -> Option<&'a CompositePlan> {
    directory.composites().iter().find(|composite| composite.name == name)
}

fn shown(directory: &Directory, composite: &CompositePlan) -> Value {
    let slots = composite.slots.iter().filter_map(|name| directory.entry(name));
    let rows: Vec<Value> = slots.map(|entry| views::component(directory, entry)).collect();
    let sum = |name: &str| rows.iter().filter_map(|row| row[name].as_u64()).sum::<u64>();
    // One word where it is the same in all of them.
    let same = |name: &str| {
        let first = rows.first().map(|row| row[name].clone()).unwrap_or_default();
        if rows.iter().all(|row| row[name] == first) { first } else { "several".into() }
    };
    json!({"slot": composite.name, "application": composite.application, "class": composite.profile,
        "primary": composite.profile, "state": same("state"), "trigger": same("trigger"), "executor": same("executor"),
        "cycles": sum("cycles"), "faults": sum("faults"), "slots": composite.slots})
}

fn ports(directory: &Directory, composite: &CompositePlan, wires: &Wires) -> Vec<Value> {
    let exported = |(name, inner): &(String, PortRef)| {
        let own = directory.entry(&inner.slot).map(|entry| views::ports(&entry.slot, wires));
        let all = own.unwrap_or_else(|| helpers::ports(directory, wires, Some(&inner.slot)));
        // The port itself, or the methods of a service: `motors/drive`.
        let shown = |mut port: Value| {
            let own = port["port"].as_str()?.to_owned();
            let method = own.strip_prefix(&inner.port).filter(|rest| rest.is_empty() || rest.starts_with('/'))?;
            port["slot"] = composite.name.as_str().into();
            port["port"] = format!("{name}{method}").into();
            port["is"] = format!("{}.{own}", inner.slot).into();
            Some(port)
        };
        all.into_iter().filter_map(shown).collect::<Vec<_>>()
    };
    composite.exports.iter().flat_map(exported).collect()
}
