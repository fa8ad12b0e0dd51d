//! Connections: both ends resolved to ports of slots, through the exported ports of composites, and checked.
//!
//! OPRoS logs a dangling end and runs on; a reversed one it does not even log. Here each is an error.

use super::application::{Assembly, Connection, End};
use super::assemble::{Assembler, Placed, Scope};
use super::composite::Export;
use super::plan::{
    ComponentPlan, ConnectionPlan, DataPortPlan, EventPortPlan, PortKind, PortRef, ServicePortPlan, SlotPlan, Usage,
};
use super::source::Word;
use super::suggest;
use crate::model::limits;
use crate::model::names::FAULT_MANAGER;

/// A port that a connection can end at.
#[derive(Clone, Debug)]
pub struct Port {
    /// Its name where it is seen.
    pub name: String,
    /// Its kind.
    pub kind: PortKind,
    /// True for output and required.
    pub is_source: bool,
    /// Type name as written.
    pub type_name: String,
    /// The slot's port that it is.
    pub end: PortRef,
}

/// The fault manager's ports, which every file may name.
#[must_use]
pub fn ports_of_fault_manager() -> Vec<Port> {
    let port = |name: &str, is_source, type_name: &str| Port {
        name: name.to_owned(),
        kind: PortKind::Event,
        is_source,
        type_name: type_name.to_owned(),
        end: PortRef { slot: FAULT_MANAGER.to_owned(), port: name.to_owned() },
    };
    vec![
        port("faults", true, "FaultNotice"),
        port("all_faults", true, "FaultNotice"),
        port("report", false, "FaultReport"),
    ]
}

const KINDS: [PortKind; 3] = [PortKind::Data, PortKind::Event, PortKind::Service];

impl Assembler {
    /// Resolves and checks one connection.
    pub(super) fn connection(&mut self, connection: &Connection, scope: &Scope) {
        if self.exhausted || self.findings.len() > limits::DIAGNOSTICS {
            return;
        }
        let kind = connection.kind;
        if let Some(other) = self.kind_of_both(connection, scope) {
            let message = format!("both ports are of kind {}, not {}", kind_name(other), kind_name(kind));
            let hint = format!("write port_type=\"{}\"", kind_name(other));
            return self.error(&connection.kind_spot, message, &hint);
        }
        let sources = self.ends(&connection.source, kind, scope);
        let targets = self.ends(&connection.target, kind, scope);
        let (Some(sources), Some(targets)) = (sources, targets) else { return };
        let wrong_source = sources.iter().any(|port| !port.is_source);
        let wrong_target = targets.iter().any(|port| port.is_source);
        if wrong_source && wrong_target {
            let message = format!("this connection is reversed: {} is no source", describe_end(&connection.source));
            return self.error(&connection.source.port.spot, message, "swap <source> and <target>");
        }
        if wrong_source || wrong_target {
            return self.wrong_direction(connection, wrong_source);
        }
        for source in &sources {
            for target in &targets {
                self.connect(connection, source, target);
            }
        }
    }

    fn wrong_direction(&mut self, connection: &Connection, source: bool) {
        let (end, what, wanted) = match (source, connection.kind) {
            (true, PortKind::Service) => {
                (&connection.source, "provides a service", "a <source> is a required service port")
            }
            (true, _) => (&connection.source, "is an input", "a <source> is an output"),
            (false, PortKind::Service) => {
                (&connection.target, "requires a service", "a <target> is a provided service port")
            }
            (false, _) => (&connection.target, "is an output", "a <target> is an input"),
        };
        self.error(&end.port.spot, format!("{} {what}", describe_end(end)), wanted);
    }

    fn connect(&mut self, connection: &Connection, source: &Port, target: &Port) {
        if self.exhausted {
            return;
        }
        if self.connections.len() >= limits::CONNECTIONS {
            self.exhausted = true;
            let message = format!("more than {} connections in one directory", limits::CONNECTIONS);
            return self.error(&connection.spot, message, "split the system into several directories");
        }
        let plan = ConnectionPlan {
            kind: connection.kind,
            source: source.end.clone(),
            target: target.end.clone(),
            validity: connection.validity.clone(),
            on_gone: connection.on_gone,
            location: connection.spot.location(),
        };
        let key = (plan.kind, plan.source.clone(), plan.target.clone());
        if let Some(line) = self.linked.get(&key) {
            let message = format!("these ports are already connected in line {line}");
            return self.error(&connection.spot, message, "remove one of the two connections");
        }
        if source.type_name != target.type_name {
            let message = format!(
                "{} is of type {}, {} of type {}",
                describe_end(&connection.source),
                source.type_name,
                describe_end(&connection.target),
                target.type_name
            );
            self.warning(
                &connection.target.port.spot,
                message,
                "names may differ; the layouts are compared when the plugins are loaded",
            );
        }
        if connection.kind == PortKind::Service && !self.called.insert(plan.source.clone()) {
            let message = format!("{} is already connected to a provider", describe_end(&connection.source));
            return self.error(&connection.source.port.spot, message, "a required service has exactly one provider");
        }
        self.linked.insert(key, plan.location.line);
        self.connections.push(plan);
    }

    /// The ports that one end of a connection means: several where a composite fans an input out.
    fn ends(&mut self, end: &End, kind: PortKind, scope: &Scope) -> Option<Vec<Port>> {
        let (found, incomplete) = match scope.get(&end.component.text) {
            Some(Placed::Slot(index)) => {
                let slot = self.slots.get(*index)?;
                let port = port_named(&slot.name, &slot.component, kind, &end.port.text);
                (Vec::from_iter(port), self.incomplete.contains(&slot.name))
            }
            Some(Placed::Composite(inside)) => {
                let named = |port: &&Port| port.name == end.port.text && port.kind == kind;
                (inside.ports.iter().filter(named).cloned().collect(), inside.incomplete)
            }
            Some(Placed::Voter(port)) => {
                let is_it = port.name == end.port.text && port.kind == kind;
                (is_it.then(|| (**port).clone()).into_iter().collect(), false)
            }
            Some(Placed::Broken) => return None,
            None if end.component.text == FAULT_MANAGER => {
                let named = |port: &Port| port.name == end.port.text && port.kind == kind;
                (ports_of_fault_manager().into_iter().filter(named).collect(), false)
            }
            None => {
                self.unknown_slot(&end.component, scope);
                return None;
            }
        };
        if found.is_empty() && !incomplete {
            let ports = self.visible_ports(&end.component, scope);
            self.unknown_port(end, kind, &ports);
        }
        (!found.is_empty()).then_some(found)
    }

    /// Every port that a connection can name at `component`.
    fn visible_ports(&self, component: &Word, scope: &Scope) -> Vec<Port> {
        match scope.get(&component.text) {
            Some(Placed::Slot(index)) => {
                self.slots.get(*index).map_or_else(Vec::new, |slot| ports_of(&slot.name, &slot.component))
            }
            Some(Placed::Composite(inside)) => inside.ports.clone(),
            Some(Placed::Voter(port)) => vec![(**port).clone()],
            None if component.text == FAULT_MANAGER => ports_of_fault_manager(),
            Some(Placed::Broken) | None => Vec::new(),
        }
    }

    fn unknown_port(&mut self, end: &End, kind: PortKind, ports: &[Port]) {
        let (slot, port) = (&end.component.text, &end.port.text);
        if let Some(other) = ports.iter().find(|other| other.name == *port) {
            let message = format!("\"{port}\" of {slot} is of kind {}, not {}", kind_name(other.kind), kind_name(kind));
            let hint = format!("write port_type=\"{}\", or name another port", kind_name(other.kind));
            return self.error(&end.port.spot, message, &hint);
        }
        let names: Vec<&str> = ports.iter().filter(|port| port.kind == kind).map(|port| port.name.as_str()).collect();
        let hint = suggest::hint(port, &names, str::to_owned)
            .unwrap_or_else(|| format!("{slot} has no {} ports", kind_name(kind)));
        self.error(&end.port.spot, format!("{slot} has no {} port \"{port}\"", kind_name(kind)), &hint);
    }

    /// Reports a name that no subcomponent of the assembly has.
    pub fn unknown_slot(&mut self, name: &Word, scope: &Scope) {
        if scope.incomplete {
            return;
        }
        let names: Vec<&str> = scope.keys().map(String::as_str).collect();
        let hint = suggest::hint(&name.text, &names, str::to_owned)
            .unwrap_or_else(|| "it must be the name of a <subcomponent> of this file".to_owned());
        self.error(&name.spot, format!("no subcomponent is called \"{}\"", name.text), &hint);
    }

    /// The ports of a composite that show outside, and whether these are all that it exports.
    pub(super) fn exports(&mut self, assembly: &Assembly, scope: &Scope) -> (Vec<Port>, bool) {
        let mut all: Vec<Port> = Vec::new();
        let mut found = 0;
        if let Some(beyond) = assembly.exports.get(limits::PORTS) {
            self.error(&beyond.name.spot, format!("more than {} exported ports", limits::PORTS), "split the composite");
        }
        for export in assembly.exports.iter().take(limits::PORTS) {
            let ports = self.exported_ports(export, scope);
            found += usize::from(!ports.is_empty());
            for port in ports {
                let clashes = |other: &Port| {
                    other.name == export.name.text
                        && (port.is_source
                            || other.kind != port.kind
                            || port.kind == PortKind::Service
                            || other.end == port.end)
                };
                if all.iter().any(clashes) {
                    let message = format!("\"{}\" is already exported", export.name.text);
                    self.error(&export.name.spot, message, "only inputs of data and events may share an exported name");
                    continue;
                }
                all.push(Port { name: export.name.text.clone(), ..port });
            }
        }
        (all, found == assembly.exports.len())
    }

    fn exported_ports(&mut self, export: &Export, scope: &Scope) -> Vec<Port> {
        let end = End { component: export.component.clone(), port: export.port.clone() };
        let known_kind = export.kind.or_else(|| self.kind_of(&end, scope));
        let Some(ports) = self.ends(&end, known_kind.unwrap_or(PortKind::Data), scope) else { return Vec::new() };
        let stated_source = match export.direction.text.as_str() {
            "output" | "required" => Some(true),
            "input" | "provided" => Some(false),
            _ => None,
        };
        if stated_source.is_some_and(|stated| ports.iter().any(|port| port.is_source != stated)) {
            let message = format!("{} is no {} port", describe_end(&end), export.direction.text);
            self.error(&export.direction.spot, message, "correct <port_dir>, or leave it out");
        }
        ports
    }

    fn kind_of(&self, end: &End, scope: &Scope) -> Option<PortKind> {
        KINDS.into_iter().find(|kind| self.has_port(end, *kind, scope))
    }

    /// The kind of the ports at both ends, where it is not the connection's.
    fn kind_of_both(&self, connection: &Connection, scope: &Scope) -> Option<PortKind> {
        let Connection { kind, source, target, .. } = connection;
        if self.has_port(source, *kind, scope) || self.has_port(target, *kind, scope) {
            return None;
        }
        KINDS.into_iter().find(|other| self.has_port(source, *other, scope) && self.has_port(target, *other, scope))
    }

    fn has_port(&self, end: &End, kind: PortKind, scope: &Scope) -> bool {
        let name = &end.port.text;
        let of_slot = |slot: &SlotPlan| port_named(&slot.name, &slot.component, kind, name).is_some();
        let is_it = |port: &Port| port.name == *name && port.kind == kind;
        match scope.get(&end.component.text) {
            Some(Placed::Slot(index)) => self.slots.get(*index).is_some_and(of_slot),
            Some(Placed::Composite(inside)) => inside.ports.iter().any(is_it),
            Some(Placed::Voter(port)) => is_it(port),
            None if end.component.text == FAULT_MANAGER => ports_of_fault_manager().iter().any(is_it),
            Some(Placed::Broken) | None => false,
        }
    }
}

/// Every port of a component in the slot of that name.
#[must_use]
pub fn ports_of(slot: &str, component: &ComponentPlan) -> Vec<Port> {
    let data = component.data_ports.iter().map(|port| data_port(slot, port));
    let events = component.event_ports.iter().map(|port| event_port(slot, port));
    let services = component.service_ports.iter().map(|port| service_port(slot, port));
    data.chain(events).chain(services).collect()
}

/// One port, without making all the others.
fn port_named(slot: &str, component: &ComponentPlan, kind: PortKind, name: &str) -> Option<Port> {
    match kind {
        PortKind::Data => component.data_ports.iter().find(|port| port.name == name).map(|port| data_port(slot, port)),
        PortKind::Event => {
            component.event_ports.iter().find(|port| port.name == name).map(|port| event_port(slot, port))
        }
        PortKind::Service => {
            component.service_ports.iter().find(|port| port.name == name).map(|port| service_port(slot, port))
        }
    }
}

fn data_port(slot: &str, port: &DataPortPlan) -> Port {
    make_port(slot, &port.name, PortKind::Data, port.usage == Usage::Output, &port.data_type)
}

fn event_port(slot: &str, port: &EventPortPlan) -> Port {
    make_port(slot, &port.name, PortKind::Event, port.usage == Usage::Output, &port.data_type)
}

fn service_port(slot: &str, port: &ServicePortPlan) -> Port {
    make_port(slot, &port.name, PortKind::Service, !port.provided, &port.type_name)
}

fn make_port(slot: &str, name: &str, kind: PortKind, is_source: bool, type_name: &str) -> Port {
    let end = PortRef { slot: slot.to_owned(), port: name.to_owned() };
    Port { name: name.to_owned(), kind, is_source, type_name: type_name.to_owned(), end }
}

/// A port in words.
pub(super) fn describe(port: &Port) -> String {
    let direction = match (port.kind, port.is_source) {
        (PortKind::Service, true) => "required",
        (PortKind::Service, false) => "provided",
        (_, true) => "output",
        (_, false) => "input",
    };
    format!("the {} {direction} \"{}\"", kind_name(port.kind), port.name)
}

fn describe_end(end: &End) -> String {
    format!("{}.{}", end.component.text, end.port.text)
}

/// The word that profiles use for a kind of port.
#[must_use]
pub const fn kind_name(kind: PortKind) -> &'static str {
    match kind {
        PortKind::Data => "data",
        PortKind::Event => "event",
        PortKind::Service => "service",
    }
}
