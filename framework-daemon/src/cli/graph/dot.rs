//! The graph for Graphviz: a record for each slot, an edge for each connection.

use std::fmt::Write;

use super::{monitored, needed};
use crate::profile::plan::{ConnectionPlan, DependencyPlan, MonitorPlan, Plan, PortKind, PortRef, SlotPlan};
use crate::profile::wire::{Port, kind_name, ports_of};

/// The text that `dot` reads.
#[must_use]
pub fn draw(plan: &Plan) -> String {
    let mut out = String::from(
        "digraph profile {\n  rankdir=LR;\n  node [shape=plain, fontname=\"sans-serif\"];\n  \
         edge [fontname=\"sans-serif\", fontsize=10];\n",
    );
    for slot in &plan.slots {
        // Writing to a string cannot fail.
        let _ = writeln!(out, "  {} [label=<{}>];", quoted(&slot.name), table(slot));
    }
    for connection in &plan.connections {
        let _ = writeln!(out, "{}", edge(connection));
    }
    for dependency in &plan.dependencies {
        out.push_str(&needs(dependency));
    }
    for (number, monitor) in plan.monitors.iter().enumerate() {
        let _ = writeln!(out, "{}", watched(number, monitor));
    }
    out.push_str("}\n");
    out
}

/// Who stops when others do: an edge to each slot that it needs, as its label reads.
fn needs(dependency: &DependencyPlan) -> String {
    let label = quoted(&needed(dependency));
    let style = format!("color=\"#a02020\", style=dotted, constraint=false, arrowhead=empty, label={label}");
    let slots = dependency.on.iter().flat_map(|needed| &needed.slots);
    slots.map(|slot| format!("  {} -> {} [{style}];\n", quoted(&dependency.slot), quoted(slot))).collect()
}

/// A monitor, and the port that it watches.
fn watched(number: usize, monitor: &MonitorPlan) -> String {
    let PortRef { slot, port } = &monitor.port;
    let port = quoted(&format!("{}_{port}", kind_name(PortKind::Data)));
    let label = quoted(&format!("monitor: {}", monitored(monitor)));
    format!(
        "  monitor{number} [shape=note, fontsize=10, label={label}];\n  {}:{port} -> monitor{number} [style=dotted, arrowhead=none];",
        quoted(slot)
    )
}

fn table(slot: &SlotPlan) -> String {
    let ports = ports_of(&slot.name, &slot.component);
    let (right, left): (Vec<&Port>, Vec<&Port>) = ports.iter().partition(|port| port.is_source);
    let mut rows = String::new();
    for index in 0..left.len().max(right.len()) {
        let _ = write!(rows, "<tr>{}{}</tr>", cell(left.get(index), "left"), cell(right.get(index), "right"));
    }
    let title = format!("<b>{}</b><br/>{}", escaped(&slot.name), escaped(&slot.component.name));
    format!(
        "<table border=\"1\" cellborder=\"0\" cellspacing=\"2\"><tr><td colspan=\"2\">{title}</td></tr>{rows}</table>"
    )
}

fn cell(port: Option<&&Port>, side: &str) -> String {
    port.map_or_else(
        || "<td></td>".to_owned(),
        |port| {
            let id = format!("{}_{}", kind_name(port.kind), port.name);
            format!("<td port=\"{}\" align=\"{side}\">{}</td>", escaped(&id), escaped(&port.name))
        },
    )
}

fn edge(connection: &ConnectionPlan) -> String {
    let end = |slot: &str, port: &str, side: &str| {
        format!("{}:{}:{side}", quoted(slot), quoted(&format!("{}_{port}", kind_name(connection.kind))))
    };
    let (source, target) = (&connection.source, &connection.target);
    let style = match connection.kind {
        PortKind::Data => "color=\"#1f5fa8\"",
        PortKind::Event => "color=\"#b35c00\", style=dashed, constraint=false",
        PortKind::Service => "color=\"#2a7d3f\", style=bold, dir=both, arrowtail=odot, constraint=false",
    };
    let label = if connection.validity.is_empty() { "" } else { ", label=\"checked\"" };
    format!("  {} -> {} [{style}{label}];", end(&source.slot, &source.port, "e"), end(&target.slot, &target.port, "w"))
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

fn escaped(text: &str) -> String {
    quick_xml::escape::escape(text).into_owned()
}
