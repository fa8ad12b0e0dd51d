//! `component_profile`: a component class.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;

use super::application::on_gone;
use super::diagnostic::{Diagnostic, Level, Reporter};
use super::fault_rules;
use super::plan::{
    ComponentPlan, DataPortPlan, Deadline, EventPortPlan, Execution, OnGone, Overflow, Policy, Property, Queue,
    Schedule, ServicePortPlan, Trigger, Usage,
};
use super::source::Span;
use super::xml::Element;
use super::{push, quantity};
use crate::model::limits;

/// A component class, as planned and as written.
#[derive(Clone, Debug, Serialize)]
pub struct ComponentProfile {
    /// What the runtime works from.
    #[serde(flatten)]
    pub plan: Arc<ComponentPlan>,
    /// What was written, where the plan says it in other words.
    pub declared: Declared,
    /// True where a port was dropped because of an error in it.
    #[serde(skip)]
    pub incomplete: bool,
    /// True where a property was.
    #[serde(skip)]
    pub lacks_properties: bool,
    /// Why it cannot run by itself: it is periodic and states no period. Its slot's executor may state one.
    #[serde(skip)]
    pub missing_period: Option<Box<Diagnostic>>,
}

/// `execution_semantics` and `execution_environment` as written.
#[derive(Clone, Debug, Serialize)]
pub struct Declared {
    /// `type`.
    pub trigger: String,
    /// `period`.
    pub period: String,
    /// `priority`.
    pub priority: String,
    /// `policy`.
    pub policy: String,
    /// `creation_type`.
    pub creation_type: String,
    /// `instance_creation`.
    pub instance_creation: String,
    /// `lifecycle_type`.
    pub lifecycle: String,
    /// `library_type`.
    pub library_type: String,
}

/// Reads `<component_profile>`.
pub fn read(root: &Element, report: &mut Reporter) -> ComponentProfile {
    let environment = root.child("execution_environment").cloned().unwrap_or_default();
    let semantics = root.child("execution_semantics").cloned().unwrap_or_default();
    let mut missing_period = None;
    let execution = execution(&semantics, &mut missing_period, report);
    check_ports(root, report);
    note_state_machine(root, report);
    let plan = ComponentPlan {
        name: root.text_of("name").to_owned(),
        version: root.text_of("version").to_owned(),
        library: environment.text_of("library_name").to_owned(),
        execution,
        properties: properties(root, report),
        data_ports: root.grandchildren("ports", "data_port").filter_map(|port| data_port(port, report)).collect(),
        event_ports: root.grandchildren("ports", "event_port").filter_map(|port| event_port(port, report)).collect(),
        service_ports: root
            .grandchildren("ports", "service_port")
            .filter_map(|port| service_port(port, report))
            .collect(),
        location: report.location(root.name_span),
    };
    let read = plan.data_ports.len() + plan.event_ports.len() + plan.service_ports.len();
    let written: usize = root.children_of("ports").map(|ports| ports.children.len()).sum();
    let declared = declared(&semantics, &environment);
    let lists = || root.children_of("properties");
    let given: usize = lists().map(|list| list.children.len()).sum();
    ComponentProfile {
        declared,
        incomplete: read != written || root.misread,
        lacks_properties: given != plan.properties.len() || lists().any(|list| list.misread) || root.misread,
        plan: Arc::new(plan),
        missing_period,
    }
}

fn declared(semantics: &Element, environment: &Element) -> Declared {
    let text = |name: &str| semantics.text_of(name).to_owned();
    Declared {
        trigger: text("type"),
        period: text("period"),
        priority: text("priority"),
        policy: text("policy"),
        creation_type: text("creation_type"),
        instance_creation: text("instance_creation"),
        lifecycle: text("lifecycle_type"),
        library_type: environment.text_of("library_type").to_owned(),
    }
}

fn note_state_machine(root: &Element, report: &mut Reporter) {
    if let Some(fsm) = root.child("fsm") {
        report.not_active(fsm.name_span, "<fsm>");
    }
}

fn execution(semantics: &Element, missing: &mut Option<Box<Diagnostic>>, report: &mut Reporter) -> Execution {
    let creation = [semantics.text_of("creation_type"), semantics.text_of("instance_creation")];
    if creation.iter().all(|text| !text.is_empty()) && creation[0] != creation[1] {
        let span = semantics.child("instance_creation").map_or(semantics.name_span, |second| second.text_span);
        report
            .error(span, format!("creation_type says \"{}\", instance_creation \"{}\"", creation[0], creation[1]))
            .hint = Some("they are two names for one thing: remove one".to_owned());
    }
    Execution {
        trigger: trigger(semantics, missing, report),
        schedule: schedule(semantics, report),
        deadline: deadline(semantics, report),
        stack: stack(semantics, report),
        autostart: matches!(semantics.text_of("lifecycle_type"), "" | "start"),
        singleton: creation.contains(&"singleton"),
    }
}

fn trigger(semantics: &Element, missing: &mut Option<Box<Diagnostic>>, report: &mut Reporter) -> Trigger {
    let kind = semantics.text_of("type");
    let period = semantics.child("period").filter(|period| !period.text.is_empty());
    if !kind.starts_with("periodic") {
        if let Some(stale) = period
            && let Err(wrong) = quantity::duration(&stale.text)
        {
            report.warning(stale.text_span, format!("period: {wrong}")).hint =
                Some(format!("a {kind} component has no period: remove it"));
        }
        return if kind == "passive" { Trigger::Passive } else { Trigger::Nonperiodic };
    }
    match period {
        // What stands there instead is told already.
        None if semantics.misread => Trigger::Periodic(limits::PERIOD_MIN),
        None => {
            let span = semantics
                .child("period")
                .or_else(|| semantics.child("type"))
                .map_or(semantics.name_span, |e| e.name_span);
            let found = report.spot(span).diagnostic(Level::Error, "a periodic component needs a period");
            *missing =
                Some(Box::new(found.with_hint("add <period>20</period> (milliseconds), or give its executor one")));
            Trigger::Periodic(Duration::ZERO)
        }
        Some(period) => Trigger::Periodic(check_period(period.text_span, &period.text, report)),
    }
}

/// A period, checked; the shortest one possible where it is wrong.
pub fn check_period(span: Span, text: &str, report: &mut Reporter) -> Duration {
    match quantity::duration(text) {
        Err(wrong) => {
            report.error(span, format!("period: {wrong}"));
        }
        Ok(period) if period < limits::PERIOD_MIN => {
            let least = quantity::format_duration(limits::PERIOD_MIN);
            report.error(span, format!("a period of {text} is too short: {least} is the least"));
        }
        Ok(period) => return period,
    }
    limits::PERIOD_MIN
}

fn schedule(semantics: &Element, report: &mut Reporter) -> Schedule {
    let policy = match semantics.text_of("policy") {
        "SCHED_FIFO" => Policy::Fifo,
        "SCHED_RR" => Policy::RoundRobin,
        _ => Policy::Other,
    };
    let Some(element) = semantics.child("priority").filter(|element| !element.text.is_empty()) else {
        if policy != Policy::Other {
            let span = semantics.child("policy").map_or(semantics.name_span, |policy| policy.text_span);
            report.error(span, "a real-time policy needs a priority, 1 to 99");
        }
        return Schedule { policy, priority: 0, cpus: Vec::new() };
    };
    let priority = element.text.parse().unwrap_or(0);
    let range = limits::PRIORITY_MIN..=limits::PRIORITY_MAX;
    if policy != Policy::Other && !range.contains(&priority) {
        report.error(element.text_span, format!("priority {priority} is out of range: 1 to 99 is possible"));
    } else if !(0..=limits::PRIORITY_MAX).contains(&priority) {
        report.warning(element.text_span, format!("priority {priority} is out of range 0 to 99")).hint =
            Some("it has no effect: the policy is SCHED_OTHER".to_owned());
    }
    Schedule { policy, priority: priority.clamp(0, limits::PRIORITY_MAX), cpus: Vec::new() }
}

fn deadline(semantics: &Element, report: &mut Reporter) -> Option<Deadline> {
    let element = semantics.child("deadline")?;
    let budget = quantity::duration(&element.text).ok()?;
    if budget.is_zero() {
        report.error(element.text_span, "deadline must be more than 0");
        return None;
    }
    let given =
        element.attribute("hang").and_then(|hang| Some((hang.value_span, quantity::duration(&hang.value).ok()?)));
    if let Some((span, _)) = given.filter(|(_, hang)| *hang < budget) {
        report.error(span, "hang must not be less than the deadline itself").hint =
            Some("a callback overruns beyond its deadline; it hangs when it does not return until then".to_owned());
        return None;
    }
    Some(Deadline { budget, hang: given.map_or(budget * limits::HANG_FACTOR, |(_, hang)| hang) })
}

fn stack(semantics: &Element, report: &mut Reporter) -> Option<usize> {
    let element = semantics.child("stack")?;
    let bytes = quantity::bytes(&element.text).ok()?;
    if !(limits::STACK_MIN_BYTES..=limits::STACK_MAX_BYTES).contains(&bytes) {
        report.error(
            element.text_span,
            format!("a stack of {} is out of range: 64KiB to 1GiB is possible", element.text),
        );
        return None;
    }
    Some(bytes)
}

/// Reads `<properties>` of a component or of a slot; a later one of the same name is an error.
pub fn properties(parent: &Element, report: &mut Reporter) -> Vec<Property> {
    let mut all: Vec<Property> = Vec::new();
    let mut names = HashSet::new();
    for element in parent.grandchildren("properties", "property") {
        let property = Property {
            name: element.value_of("name").to_owned(),
            type_name: element.value_of("type").to_owned(),
            value: element.text.clone(),
        };
        if property.name.is_empty() {
            continue;
        }
        if !names.insert(property.name.clone()) {
            let word = report.value_word(element, "name");
            report.error(word.spot.span, format!("property \"{}\" is given twice", property.name)).hint =
                Some("remove one of them".to_owned());
            continue;
        }
        check_property_type(element, &property, report);
        all.push(property);
    }
    all
}

/// A warning only: the component reads the text itself, and ten shipped profiles say `True` for an `int`.
fn check_property_type(element: &Element, property: &Property, report: &mut Reporter) {
    if !fits(&property.type_name, &property.value) {
        let Property { name, type_name, value } = property;
        let message = format!("property \"{name}\": \"{value}\" is not of type {type_name}");
        report.warning(element.text_span, message).hint = Some("the component gets the text as it is".to_owned());
    }
}

/// True where a text is of a type, or nobody can tell.
#[must_use]
pub fn fits(type_name: &str, text: &str) -> bool {
    match type_name {
        _ if text.is_empty() => true,
        "int" | "long" | "short" | "int32_t" | "int64_t" => text.parse::<i64>().is_ok(),
        "unsigned int" | "unsigned long" | "unsigned" | "uint32_t" | "uint64_t" => text.parse::<u64>().is_ok(),
        "double" | "float" => quantity::number(text).is_ok(),
        "bool" => ["true", "false", "0", "1"].iter().any(|word| text.eq_ignore_ascii_case(word)),
        _ => true,
    }
}

fn check_ports(root: &Element, report: &mut Reporter) {
    let count: usize = root.children_of("ports").map(|ports| ports.children.len()).sum();
    if count > limits::PORTS {
        report.error(root.name_span, format!("{count} ports; {} is the most", limits::PORTS));
    }
    let mut seen: HashMap<&str, &Element> = HashMap::new();
    for port in root.children_of("ports").flat_map(|ports| &ports.children) {
        let Some(name) = port.child("name").filter(|name| !name.text.is_empty()) else { continue };
        let Some(first) = seen.get(name.text.as_str()) else {
            seen.insert(&name.text, port);
            continue;
        };
        let (line, kind) = (report.location(first.name_span).line, first.name.replace('_', " "));
        let message = format!("port \"{}\" is already declared in line {line}, as a {kind}", name.text);
        // Two kinds of port have names of their own in OPRoS, where this was no mistake.
        if first.name == port.name {
            report.error(name.text_span, message).hint = Some("give each port a name of its own".to_owned());
        } else {
            report.warning(name.text_span, message);
        }
    }
}

fn usage(port: &Element) -> Option<Usage> {
    match port.text_of("usage") {
        "input" => Some(Usage::Input),
        "output" => Some(Usage::Output),
        _ => None,
    }
}

/// One without is told already, and nothing can be connected with it.
fn has_name(port: &Element) -> bool {
    !port.text_of("name").is_empty()
}

fn data_port(port: &Element, report: &mut Reporter) -> Option<DataPortPlan> {
    let (queue, validity, max_age) =
        (queue(port, report), fault_rules::validities(port, report), fault_rules::max_age(port, report));
    let usage = usage(port).filter(|_| has_name(port))?;
    if let Some(age) = port.child("max_age").filter(|_| usage == Usage::Output) {
        report.error(age.name_span, "<max_age> belongs to an input: an output cannot know how long nobody wrote");
    }
    Some(DataPortPlan {
        name: port.text_of("name").to_owned(),
        usage,
        data_type: port.text_of("data_type").to_owned(),
        queue,
        validity,
        max_age,
        push: push::push(port, usage, report),
        location: report.location(port.name_span),
    })
}

/// OPRoS spells the policy three ways and applies none of them; the first of `SPELLINGS` that says something counts here.
fn queue(port: &Element, report: &mut Reporter) -> Queue {
    const SPELLINGS: [&str; 3] = ["queueing_policy", "queuing_policy", "policy"];
    let mut given = SPELLINGS.iter().filter_map(|name| port.child(name)).filter(|policy| !policy.text.is_empty());
    let policy = given.next();
    if let Some(other) = given.find(|other| Some(&other.text) != policy.map(|policy| &policy.text)) {
        report.error(other.text_span, format!("<{}> contradicts the other policy of this port", other.name)).hint =
            Some("remove one of them".to_owned());
    }
    let overflow = port.child("overflow");
    match policy.map_or("", |policy| policy.text.as_str()) {
        "FIFO" => return Queue::Fifo { size: queue_size(port, report), overflow: overflow_rule(port) },
        "" | "LAST" => {}
        other => {
            let span = policy.map_or(port.name_span, |policy| policy.text_span);
            report.not_active(span, &format!("policy {other} (the port keeps the newest value, as LAST)"));
        }
    }
    if let Some(overflow) = overflow {
        report.error(overflow.name_span, "<overflow> needs a FIFO").hint =
            Some("add <queueing_policy>FIFO</queueing_policy> and <queue_size>".to_owned());
    }
    Queue::Last
}

fn overflow_rule(port: &Element) -> Overflow {
    match port.text_of("overflow") {
        "drop_newest" => Overflow::DropNewest,
        "fault" => Overflow::Fault,
        _ => Overflow::DropOldest,
    }
}

fn queue_size(port: &Element, report: &mut Reporter) -> usize {
    let sizes = port.children_of("queue_size").chain(port.children_of("policy_param"));
    let Some(element) = sizes.into_iter().find(|size| !size.text.is_empty()) else { return limits::FIFO_SIZE_DEFAULT };
    match element.text.parse::<usize>() {
        Ok(size) if (1..=limits::FIFO_SIZE_MAX).contains(&size) => return size,
        Ok(_) => {
            let message =
                format!("a queue of {} is out of range: 1 to {} is possible", element.text, limits::FIFO_SIZE_MAX);
            report.error(element.text_span, message);
        }
        // Not a number: `conform` has said so.
        Err(_) => {}
    }
    limits::FIFO_SIZE_DEFAULT
}

fn event_port(port: &Element, report: &mut Reporter) -> Option<EventPortPlan> {
    let usage = usage(port).filter(|_| has_name(port))?;
    let receives = usage == Usage::Input;
    let queue_size = belonging(port, "queue_size", receives, report).and_then(|element| element.text.parse().ok());
    let _ = belonging(port, "overflow", receives, report);
    Some(EventPortPlan {
        name: port.text_of("name").to_owned(),
        usage,
        data_type: port.text_of("data_type").to_owned(),
        queue_size,
        overflow: overflow_rule(port),
        activations: count(port, "activations", receives, limits::ACTIVATIONS_DEFAULT, report),
        timeout: timeout(port, receives, report),
        location: report.location(port.name_span),
    })
}

fn service_port(port: &Element, report: &mut Reporter) -> Option<ServicePortPlan> {
    let provided = match port.text_of("usage") {
        "provided" => true,
        "required" => false,
        _ => return None,
    };
    has_name(port).then(|| ServicePortPlan {
        name: port.text_of("name").to_owned(),
        provided,
        type_name: port.text_of("type").to_owned(),
        reference: port.text_of("reference").to_owned(),
        queue_size: count(port, "queue_size", provided, limits::INBOX_DEFAULT, report),
        pending: count(port, "pending", !provided, limits::PENDING_DEFAULT, report),
        timeout: timeout(port, !provided, report),
        on_gone: on_gone_of(port, !provided, report),
        location: report.location(port.name_span),
    })
}

/// The element of that name, where it belongs to this side of a service or an event.
fn belonging<'a>(port: &'a Element, name: &str, belongs: bool, report: &mut Reporter) -> Option<&'a Element> {
    let element = port.child(name).filter(|element| !element.text.is_empty())?;
    if belongs {
        return Some(element);
    }
    let side = match port.text_of("usage") {
        "provided" => "a required service",
        "output" => "an input of events",
        _ => "a provided service",
    };
    report.error(element.name_span, format!("<{name}> belongs to {side}"));
    None
}

fn count(port: &Element, name: &str, belongs: bool, default: usize, report: &mut Reporter) -> usize {
    // Its range is the vocabulary's.
    belonging(port, name, belongs, report).and_then(|element| element.text.parse().ok()).unwrap_or(default)
}

fn timeout(port: &Element, belongs: bool, report: &mut Reporter) -> Duration {
    let Some(element) = belonging(port, "timeout", belongs, report) else { return limits::WAIT };
    match quantity::duration(&element.text) {
        Ok(time) if !time.is_zero() => return time,
        Ok(_) => _ = report.error(element.text_span, "a timeout must be more than 0"),
        // Not a time: `conform` has said so.
        Err(_) => {}
    }
    limits::WAIT
}

fn on_gone_of(port: &Element, belongs: bool, report: &mut Reporter) -> OnGone {
    let element = belonging(port, "on_gone", belongs, report);
    element.and_then(|_| on_gone(port)).unwrap_or_default()
}
