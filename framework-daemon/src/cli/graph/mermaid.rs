//! The graph for Markdown pages that draw Mermaid.

use std::fmt::Write;

use super::{monitored, needed};
use crate::profile::plan::{ConnectionPlan, DependencyPlan, MonitorPlan, Plan, PortKind, PortRef};

/// The text that Mermaid reads.
#[must_use]
pub fn draw(plan: &Plan) -> String {
    let mut out = String::from("flowchart LR\n");
    for (application, name) in plan.applications.iter().enumerate() {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "  subgraph a{application}[\"{}\"]", escaped(name));
        for (index, slot) in plan.slots.iter().enumerate().filter(|(_, slot)| slot.application == *name) {
            let _ =
                writeln!(out, "    s{index}[\"<b>{}</b><br/>{}\"]", escaped(&slot.name), escaped(&slot.component.name));
        }
        out.push_str("  end\n");
    }
    for connection in &plan.connections {
        out.push_str(&edge(plan, connection));
    }
    for dependency in &plan.dependencies {
        out.push_str(&needs(plan, dependency));
    }
    for (number, monitor) in plan.monitors.iter().enumerate() {
        out.push_str(&watched(plan, number, monitor));
    }
    out
}

/// Who stops when others do: an edge to each slot that it needs, as its label reads.
fn needs(plan: &Plan, dependency: &DependencyPlan) -> String {
    let id = |name: &str| plan.slots.iter().position(|slot| slot.name == name).unwrap_or_default();
    let label = escaped(&needed(dependency));
    let slots = dependency.on.iter().flat_map(|needed| &needed.slots);
    slots.map(|slot| format!("  s{} -.->|\"{label}\"| s{}\n", id(&dependency.slot), id(slot))).collect()
}

/// A monitor, and the port that it watches.
fn watched(plan: &Plan, number: usize, monitor: &MonitorPlan) -> String {
    let PortRef { slot, port } = &monitor.port;
    let slot = plan.slots.iter().position(|placed| placed.name == *slot).unwrap_or_default();
    let label = escaped(&monitored(monitor));
    format!("  m{number}([\"monitor: {label}\"])\n  s{slot} -.-|\"{}\"| m{number}\n", escaped(port))
}

fn edge(plan: &Plan, connection: &ConnectionPlan) -> String {
    let id = |name: &str| plan.slots.iter().position(|slot| slot.name == name).unwrap_or_default();
    let (source, target) = (&connection.source, &connection.target);
    let arrow = match connection.kind {
        PortKind::Data => "-->",
        PortKind::Event => "-.->",
        PortKind::Service => "==>",
    };
    let label =
        if source.port == target.port { source.port.clone() } else { format!("{} to {}", source.port, target.port) };
    format!("  s{} {arrow}|\"{}\"| s{}\n", id(&source.slot), escaped(&label), id(&target.slot))
}

/// Mermaid's own escapes: `#` begins one.
fn escaped(text: &str) -> String {
    text.replace('#', "#35;").replace('"', "#quot;").replace('<', "#lt;").replace('>', "#gt;")
}
