//! How everything is, as JSON for programs and as tables for people; made from counters and states, without asking any
//! component. The journal, the log and the control socket show the same.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use component_sdk::object::TypeDescriptor;
use serde_json::{Value, json};

use super::directory::{Directory, End, Entry, Wires};
use crate::detect::device::Lost;
use crate::exec::slot::Slot;
use crate::exec::task::Task;
use crate::exec::workshop::Shelf;
use crate::fault::ledger::Ledger;
use crate::fault::manager::Outlook;
use crate::model::lifecycle::State;
use crate::model::limits::{LOST_THREADS_MAX, QUARANTINED_MAX, STACK_BYTES};
use crate::model::time::nanoseconds;
use crate::port::border::PortEnd;
use crate::port::input::InPort;
use crate::port::output::OutPort;
use crate::port::pattern::event_client::EventClient;
use crate::port::pattern::event_server::EventServer;
use crate::port::pattern::objects::Objects;
use crate::port::pattern::provider::Provider;
use crate::port::pattern::requestor::Requestor;
use crate::port::registry;
use crate::profile::plan::{Execution, Queue, SlotPlan, Trigger};
use crate::supervise::monitors::MONITOR;
use crate::sys::clock;

/// Columns of the table of slots, in order. Each is a field of [`of_running`].
const COLUMNS: [&str; 10] =
    ["slot", "state", "class", "cycles", "missed", "faults", "quarantined", "tainted", "spares", "reason"];

/// A slot, with the state that it is or was in.
#[must_use]
pub fn of_slot(slot: &Slot, state: State) -> Value {
    let status = &slot.status;
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    json!({"slot": slot.name, "class": status.class(), "state": state, "cycles": count(&status.cycles),
        "missed": count(&status.missed), "faults": count(&status.faults),
        "quarantined": count(&status.quarantined), "tainted": count(&status.tainted),
        "longest_ns": count(&status.longest_ns)})
}

/// A slot of a running daemon, with its spares, and why it does not run where it does not.
#[must_use]
pub fn of_running(slot: &Slot, shelf: &Shelf, outlook: &Outlook) -> Value {
    let (ready, wanted) = shelf.stock();
    let mut fields = of_slot(slot, slot.status.state());
    fields["spares"] = ready.into();
    fields["spares_wanted"] = wanted.into();
    let lost = slot.devices.lost();
    if !lost.is_empty() {
        fields["lost_devices"] = lost.iter().map(lost_device).collect::<Vec<_>>().into();
    }
    if let Some(reason) = outlook.reason(slot.name) {
        fields["reason"] = reason.into();
    }
    fields
}

/// A device that is lost.
fn lost_device(lost: &Lost) -> Value {
    json!({"device": lost.device.as_str(), "lost_ns": clock::now_ns().saturating_sub(lost.since_ns)})
}

/// `slot motors: left sonar is lost, for 3.2 s`, a line each.
fn lost_devices(slots: &[Value]) -> impl Iterator<Item = String> + '_ {
    slots.iter().flat_map(|slot| {
        let lost = slot["lost_devices"].as_array().map(Vec::as_slice).unwrap_or_default();
        lost.iter().map(|lost| {
            let seconds = lost["lost_ns"].as_f64().unwrap_or_default() / 1e9;
            format!("slot {}: {} is lost, for {seconds:.1} s", cell(&slot["slot"]), cell(&lost["device"]))
        })
    })
}

/// What faults have cost the process, and what they may cost.
#[must_use]
pub fn of_process(ledger: Ledger) -> Value {
    json!({"threads_lost": ledger.threads_lost, "threads_lost_max": LOST_THREADS_MAX,
        "quarantined": ledger.quarantined, "quarantined_max": QUARANTINED_MAX, "tainted": ledger.tainted})
}

/// How everything is: what a person reads, a line each.
#[must_use]
pub fn status_table(slots: &[Value], process: &Value) -> Vec<String> {
    let count = |name: &str| process[name].as_u64().unwrap_or_default();
    let memory = if count("tainted") > 0 { "suspect" } else { "sound" };
    // Where all run there is nothing to give reasons for.
    let has_reasons = slots.iter().any(|slot| !slot["reason"].is_null());
    let mut lines = table(&COLUMNS[..COLUMNS.len() - usize::from(!has_reasons)], slots);
    lines.extend(lost_devices(slots));
    lines.push(format!(
        "threads given up: {} of at most {}; instances given up: {} of at most {}; memory: {memory}",
        count("threads_lost"),
        count("threads_lost_max"),
        count("quarantined"),
        count("quarantined_max"),
    ));
    lines
}

/// Those fields of each row in aligned columns, below their names.
#[must_use]
pub fn table(columns: &[&str], rows: &[Value]) -> Vec<String> {
    let head = columns.iter().map(|name| (*name).to_owned()).collect();
    let cells = |row: &Value| columns.iter().map(|name| cell(&row[*name])).collect();
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(rows.iter().map(cells)).collect();
    let width = |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..columns.len()).map(|column| width(column).unwrap_or_default()).collect();
    let line = |row: &Vec<String>| {
        let cells: Vec<_> = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        cells.join("  ").trim_end().to_owned()
    };
    rows.iter().map(line).collect()
}

/// A value as it is read: texts without quotes, nothing as a dash, a list with commas.
#[must_use]
pub fn cell(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::String(text) if text.is_empty() => "-".to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(values) if values.is_empty() => "-".to_owned(),
        Value::Array(values) => values.iter().map(cell).collect::<Vec<_>>().join(", "),
        other => other.to_string(),
    }
}

/// A slot with where it comes from and what runs it.
#[must_use]
pub fn component(directory: &Directory, entry: &Entry) -> Value {
    let (status, plan) = (&entry.slot.status, directory.plan_of(entry));
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    json!({"slot": entry.slot.name, "application": plan.map(|plan| plan.application.as_str()),
        "class": status.class(), "primary": plan.map(|plan| plan.component.name.as_str()), "state": status.state(),
        "trigger": plan.map(|plan| trigger(&plan.component.execution)), "executor": plan.map(executor),
        "cycles": count(&status.cycles), "faults": count(&status.faults)})
}

/// All that is known of a slot.
#[must_use]
pub fn component_details(directory: &Directory, entry: &Entry, outlook: &Outlook) -> Value {
    let mut fields = component(directory, entry);
    let more =
        [of_running(&entry.slot, &entry.shelf, outlook), directory.plan_of(entry).map(details).unwrap_or_default()];
    for (name, value) in more.into_iter().filter_map(|fields| fields.as_object().cloned()).flatten() {
        fields[name] = value;
    }
    let recovery = &entry.slot.status.recovery;
    if recovery.last_ns.load(Ordering::Relaxed) > 0 {
        fields["recovery_last_ns"] = recovery.last_ns.load(Ordering::Relaxed).into();
        fields["recovery_worst_ns"] = recovery.worst_ns.load(Ordering::Relaxed).into();
    }
    fields["recoveries_late"] = recovery.late.load(Ordering::Relaxed).into();
    fields["tasks"] = entry.slot.tasks.all().iter().map(|each| task(each)).collect::<Vec<_>>().into();
    fields["ports"] = ports(&entry.slot, &directory.wires()).into();
    fields
}

/// A thread of a component.
fn task(task: &Task) -> Value {
    let period = task.period_ns.map_or_else(|| "once".to_owned(), |ns| format!("every {:?}", Duration::from_nanos(ns)));
    json!({"task": task.name.as_str(), "runs": period, "count": task.runs()})
}

/// What the profiles say of a slot.
fn details(plan: &SlotPlan) -> Value {
    let (component, rules) = (&plan.component, &plan.rules);
    let execution = &component.execution;
    let secondaries = rules.secondaries.iter();
    let secondaries: Vec<Value> =
        secondaries.map(|each| json!({"class": each.component.name, "preload": each.preload})).collect();
    let reset = rules.reset.map(|reset| json!({"limit": reset.limit, "within_ns": nanoseconds(reset.within)}));
    json!({"version": component.version, "library": component.library, "autostart": execution.autostart,
        "deadline_ns": execution.deadline.map(|deadline| nanoseconds(deadline.budget)),
        "stack_bytes": execution.stack.unwrap_or(STACK_BYTES), "properties": plan.properties,
        "severity": rules.severity, "reset": reset, "secondaries": secondaries,
        "checkpoint_ns": rules.checkpoint.map(nanoseconds), "recovery_within_ns": rules.recovery_within.map(nanoseconds),
        "declared": format!("{}:{}", plan.location.file.display(), plan.location.line)})
}

fn trigger(execution: &Execution) -> String {
    match execution.trigger {
        Trigger::Periodic(period) => format!("every {period:?}"),
        Trigger::Nonperiodic => "data".to_owned(),
        Trigger::Passive => "never".to_owned(),
    }
}

fn executor(plan: &SlotPlan) -> &str {
    plan.executor.as_deref().unwrap_or("its own")
}

/// The ports of a slot: inputs, outputs, clients, servers, event ports.
#[must_use]
pub fn ports(slot: &Slot, wires: &Wires) -> Vec<Value> {
    slot.entries().map(|entry| known_as(&entry, port(&entry, wires))).collect()
}

fn port(entry: &registry::Entry, wires: &Wires) -> Value {
    let slot = entry.slot;
    match &entry.end {
        PortEnd::In(port) => input(slot, port, wires.of(port)),
        PortEnd::Out(port) => output(slot, port, wires.of(port)),
        PortEnd::Requestor(port) => client(slot, port, wires.of(port)),
        PortEnd::Provider(port) => server(slot, port, wires.of(port)),
        PortEnd::EventIn(event) => turned(input(slot, &event.port, wires.of(&event.port)), "event input"),
        PortEnd::EventOut(port) => turned(output(slot, port, wires.of(port)), "event output"),
        PortEnd::EventClient(port) => event_client(slot, port, wires.of(port)),
        PortEnd::EventServer(port) => event_server(slot, port, wires.of(port)),
    }
}

/// Adds the name by which others find a port, where its component gave it another than its own; empty: they do not.
fn known_as(entry: &registry::Entry, mut fields: Value) -> Value {
    let name = registry::shared().name_of(entry).unwrap_or_default();
    if name != entry.end.name() {
        fields["known_as"] = name.into();
    }
    fields
}

fn turned(mut fields: Value, direction: &str) -> Value {
    fields["direction"] = direction.into();
    fields
}

fn told_for(event: &TypeDescriptor, parameter: &TypeDescriptor) -> String {
    format!("{} for {}", event.name, parameter.name)
}

fn event_client(slot: &str, port: &EventClient, servers: &[End]) -> Value {
    let (activations, activations_max, waiting, handled) = port.counts();
    json!({"slot": slot, "port": port.name, "direction": "event client", "type": told_for(port.event, port.parameter),
        "connections": names(servers), "activations": activations, "activations_max": activations_max,
        "waiting": waiting, "handled": handled})
}

fn event_server(slot: &str, port: &EventServer, clients: &[End]) -> Value {
    let (activations, fired, dropped) = port.counts();
    json!({"slot": slot, "port": port.name, "direction": "event server", "type": told_for(port.event, port.parameter),
        "connections": names(clients), "activations": activations, "fired": fired, "dropped": dropped})
}

fn input(slot: &str, port: &InPort, writers: &[End]) -> Value {
    let (received, dropped) = port.counts();
    let mut fields = json!({"slot": slot, "port": port.name, "direction": "input", "type": port.object.name.as_str(),
        "connections": names(writers), "policy": policy(port.policy()), "received": received, "dropped": dropped,
        "waiting": port.queued()});
    if let Some(hearing) = port.hearing() {
        fields["max_age_ns"] = hearing.max_age_ns.into();
    }
    if let Some(turn) = port.turn() {
        fields["every"] = turn.every().into();
    }
    fields
}

pub(super) fn output(slot: &str, port: &OutPort, readers: &[End]) -> Value {
    let mut fields = json!({"slot": slot, "port": port.name, "direction": "output", "type": port.object.name.as_str(),
        "connections": names(readers)});
    if let Some(taps) = port.taps() {
        fields["heard_by"] = taps.iter().map(|tap| tap.name()).collect::<Vec<_>>().into();
    }
    let monitors = monitors(port);
    if !monitors.is_empty() {
        fields["monitors"] = monitors.into();
    }
    let (cycle, (early, missed)) = (port.outlet().cycle(), port.outlet().counts());
    if let Some(period_ns) = cycle.period_ns {
        fields["period_ns"] = period_ns.into();
        fields["running"] = port.outlet().is_running().into();
        fields["missed"] = missed.into();
    }
    if cycle.min_cycle_ns > 0 {
        fields["min_cycle_ns"] = cycle.min_cycle_ns.into();
        fields["early"] = early.into();
    }
    fields
}

/// Those of the framework's inputs that watch an output.
fn monitors(port: &OutPort) -> Vec<String> {
    let links = port.links().into_iter().map(|link| link.target);
    links.filter(|input| input.is_tap() && input.name.starts_with(MONITOR)).map(|input| input.name.clone()).collect()
}

fn client(slot: &str, port: &Requestor, servers: &[End]) -> Value {
    let (asked, failed) = port.counts();
    json!({"slot": slot, "port": port.name, "direction": "client", "type": exchange(port.objects),
        "connections": names(servers), "asked": asked, "failed": failed})
}

fn server(slot: &str, port: &Provider, clients: &[End]) -> Value {
    let (waiting, in_hand, refused) = port.counts();
    json!({"slot": slot, "port": port.name, "direction": "server", "type": exchange(port.objects),
        "connections": names(clients), "waiting": waiting, "in_hand": in_hand, "refused": refused})
}

fn exchange(objects: Objects) -> String {
    format!("{} -> {}", objects.request.name, objects.answer.map_or("nothing", |answer| answer.name.as_str()))
}

fn names(ends: &[End]) -> Vec<String> {
    ends.iter().map(ToString::to_string).collect()
}

/// The layout of what that port carries; `None`: there is no such port.
#[must_use]
pub fn port_layout(slot: &Slot, port: &str) -> Option<Value> {
    let data = slot.reader(port).map(|port| port.object).or_else(|| slot.writer(port).map(|port| port.object));
    let client = || slot.requestor(port).map(|port| port.objects);
    let server = || slot.provider(port).map(|port| port.objects);
    let service = || client().or_else(server);
    let exchanged = |objects: Objects| match objects.answer {
        Some(answer) => json!({"request": layout(objects.request), "answer": layout(answer)}),
        None => json!({"message": layout(objects.request)}),
    };
    data.map(layout).or_else(|| service().map(exchanged)).or_else(|| event_layout(slot, port))
}

fn event_layout(slot: &Slot, port: &str) -> Option<Value> {
    let events = &slot.events;
    let asked = events.clients.iter().find(|event| event.name == port).map(|event| (event.parameter, event.event));
    let told = || events.servers.iter().find(|event| event.name == port).map(|event| (event.parameter, event.event));
    let (parameter, event) = asked.or_else(told)?;
    Some(json!({"parameter": layout(parameter), "event": layout(event)}))
}

fn policy(queue: Queue) -> String {
    match queue {
        Queue::Last => "newest".to_owned(),
        Queue::Fifo { size, .. } => format!("fifo of {size}"),
    }
}

/// Deepest part of a layout that is shown.
const LAYOUT_DEPTH: usize = 16;

/// The layout of what a port carries.
#[must_use]
pub fn layout(object: &TypeDescriptor) -> Value {
    layout_to(object, LAYOUT_DEPTH)
}

fn layout_to(object: &TypeDescriptor, depth: usize) -> Value {
    let mut shown = json!({"name": object.name.as_str(), "kind": object.kind.opros_name(), "size": object.size});
    let Some(depth) = depth.checked_sub(1) else { return shown };
    if object.count > 0 {
        shown["count"] = object.count.into();
    }
    if let Some(element) = object.element.into_option() {
        shown["element"] = layout_to(element, depth);
    }
    let fields = object.fields.iter();
    let fields: Vec<Value> = fields
        .map(|field| json!({"name": field.name.as_str(), "offset": field.offset, "type": layout_to(field.object, depth)}))
        .collect();
    if !fields.is_empty() {
        shown["fields"] = fields.into();
    }
    shown
}

#[cfg(test)]
mod tests {
    use component_sdk::object::CommObject;
    use component_sdk::objects::Twist;

    use super::*;

    #[test]
    fn the_table_is_aligned_and_tells_the_bounds() {
        let slot = json!({"slot": "avoider", "state": "active", "class": "AvoidancePrimary", "cycles": 12, "missed": 0,
            "faults": 3, "quarantined": 2, "tainted": 1, "spares": 1});
        let lines = status_table(&[slot], &of_process(Ledger { threads_lost: 0, quarantined: 2, tainted: 1 }));
        assert_eq!(lines.len(), 3);
        assert_eq!(lines[0].find("class"), lines[1].find("AvoidancePrimary"));
        assert!(lines[2].ends_with("instances given up: 2 of at most 1000000; memory: suspect"), "{}", lines[2]);
    }

    #[test]
    fn a_layout_names_its_fields_all_the_way_down() {
        let shown = layout(Twist::DESCRIPTOR);
        assert_eq!((shown["name"].as_str(), shown["size"].as_u64()), (Some("Twist"), Some(48)));
        assert_eq!(shown["fields"][1]["name"], "angular");
        assert_eq!(
            shown["fields"][1]["type"]["fields"][2],
            json!({"name": "z", "offset": 16,
            "type": {"name": "double", "kind": "double", "size": 8}})
        );
    }

    #[test]
    fn what_is_not_there_is_a_dash() {
        assert_eq!(table(&["a", "b"], &[json!({"b": ["x", "y"]})]), ["a  b", "-  x, y"]);
    }
}
