//! `describe`: the component profiles that a plugin's own metadata gives, with the objects that its ports carry.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use component_sdk::abi::class::{Direction, Pattern, PortDecl, TriggerDecl};
use component_sdk::abi::push::{PushDecl, PushEnd};
use component_sdk::object::{Kind, TypeDescriptor};
use quick_xml::escape::escape;
use serde_json::{Value, json};

use super::Format;
use super::exit_code::Exit;
use crate::model::limits::{ACTIVATIONS_DEFAULT, FIFO_SIZE_DEFAULT, INBOX_DEFAULT, PENDING_DEFAULT, WAIT};
use crate::plugin::interface::{self, type_name};
use crate::plugin::{Class, Plugin};
use crate::port::border::HOST;
use crate::profile::quantity;

const EXAMPLES: &str = "Examples:\n  framework-daemon describe target/release/libavoidance_primary.so\n  \
     framework-daemon describe --format json libcamera.so\n  \
     framework-daemon describe --into profiles/new libcamera.so\n\n\
     A file that is there already is not overwritten.\n\n\
     Exit codes: 0 described, 1 a file cannot be written, 4 the plugin is refused.";

/// Arguments of `describe`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Plugin: a shared library that exports component classes.
    #[arg(value_name = "PLUGIN.so")]
    pub plugin: PathBuf,
    /// text: component profiles and data types as XML; json: one object a class.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
    /// Write each component profile to CLASS.xml in this directory instead of printing it.
    #[arg(long, value_name = "DIR", conflicts_with = "format")]
    pub into: Option<PathBuf>,
}

/// Describes every class of a plugin.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    let plugin = match Plugin::load(&arguments.plugin, &HOST) {
        Ok(plugin) => plugin,
        Err(refusal) => {
            writeln!(io::stderr(), "{refusal}")?;
            return Ok(Exit::PluginRefused);
        }
    };
    if let Some(directory) = &arguments.into {
        return write_files(&plugin, directory, out);
    }
    for class in plugin.classes() {
        match arguments.format {
            Format::Text => write!(out, "{}", profile(&class))?,
            Format::Json => writeln!(out, "{}", object(&class))?,
        }
    }
    Ok(Exit::Done)
}

/// One file a class; a file that is there already is kept.
fn write_files(plugin: &std::sync::Arc<Plugin>, directory: &Path, out: &mut impl Write) -> io::Result<Exit> {
    for class in plugin.classes() {
        let path = directory.join(format!("{}.xml", class.name()));
        if !write_file(&path, &profile(&class), out)? {
            return Ok(Exit::Failed);
        }
        for (name, text) in interface::interfaces(class.exported().decl.ports.as_slice()) {
            let path = directory.join(interface::file_name(&name));
            // Client and server have the same.
            let is_there = std::fs::read_to_string(&path).is_ok_and(|there| there == text);
            if !is_there && !write_file(&path, &text, out)? {
                return Ok(Exit::Failed);
            }
        }
    }
    Ok(Exit::Done)
}

/// False: it is there already, or cannot be written; told on stderr.
fn write_file(path: &Path, text: &str, out: &mut impl Write) -> io::Result<bool> {
    let written = File::create_new(path).and_then(|mut file| file.write_all(text.as_bytes()));
    if let Err(error) = written {
        writeln!(io::stderr(), "{}: {error}", path.display())?;
        return Ok(false);
    }
    writeln!(out, "{}", path.display())?;
    Ok(true)
}

fn period(period_ns: u64) -> String {
    format!("{:?}", Duration::from_nanos(period_ns)).replace('\u{b5}', "u")
}

/// The class as a component profile, in OPRoS's dialect.
fn profile(class: &Class) -> String {
    let decl = &class.exported().decl;
    let library = class.plugin().file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let semantics = match decl.trigger {
        TriggerDecl::Periodic { period_ns } => {
            format!("<type>periodic</type>\n    <period>{}</period>", period(period_ns))
        }
        TriggerDecl::Nonperiodic => "<type>non-periodic</type>".into(),
        TriggerDecl::Passive => "<type>passive</type>".into(),
    };
    let properties: String = decl.properties.iter().fold(String::new(), |mut text, property| {
        let unit = if property.unit.is_empty() {
            String::new()
        } else {
            format!(" <!-- {} -->", escape(property.unit.as_str()))
        };
        let (name, kind, value) = (property.name, property.kind.opros_name(), escape(property.default.as_str()));
        let _ = writeln!(text, "    <property name=\"{name}\" type=\"{kind}\">{value}</property>{unit}");
        text
    });
    let all = decl.ports.as_slice();
    let ports: String = all.iter().filter(|port| is_shown(port, all)).map(port).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<component_profile>\n  <name>{}</name>\n  <version>{}</version>\n  \
         <description>{}</description>\n  <execution_environment>\n    <library_type>so</library_type>\n    \
         <library_name>{}</library_name>\n    <impl_language>Rust</impl_language>\n  </execution_environment>\n  \
         <execution_semantics>\n    {semantics}\n  </execution_semantics>\n  <properties>\n{properties}  </properties>\n  \
         <ports>\n{ports}  </ports>\n</component_profile>\n{}{}",
        decl.name,
        decl.version,
        escape(decl.description.as_str()),
        escape(library.as_str()),
        data_types(all),
        interfaces(all)
    )
}

/// Of a service port the first method stands for all.
fn is_shown(port: &PortDecl, all: &[PortDecl]) -> bool {
    port.method.is_empty()
        || interface::methods(all, port.name.as_str()).next().is_some_and(|first| first.method == port.method)
}

/// The interfaces of the service ports, each in the file that the profile refers to.
fn interfaces(ports: &[PortDecl]) -> String {
    let interfaces = interface::interfaces(ports).into_iter();
    interfaces.map(|(name, text)| format!("<!-- {}:\n{text}-->\n", interface::file_name(&name))).collect()
}

fn port(port: &PortDecl) -> String {
    match port.pattern {
        Pattern::Push => data_port(port),
        Pattern::Query | Pattern::Send => service_port(port),
        Pattern::Event | Pattern::EventPort => event_port(port),
    }
}

fn service_port(port: &PortDecl) -> String {
    let service = (!port.method.is_empty()).then(|| port.service.as_str());
    let description = if service.is_some() { "" } else { port.description.as_str() };
    let reference = service.map(|service| format!("\n      <reference>{}</reference>", interface::file_name(service)));
    let settings = if port.direction == Direction::Input {
        format!("<queue_size>{INBOX_DEFAULT}</queue_size>")
    } else if port.pattern == Pattern::Send && service.is_none() {
        format!("<pending>{PENDING_DEFAULT}</pending>\n      <on_gone>fail</on_gone>")
    } else {
        let timeout = quantity::format_duration(WAIT);
        format!(
            "<pending>{PENDING_DEFAULT}</pending>\n      <timeout>{timeout}</timeout>\n      <on_gone>fail</on_gone>"
        )
    };
    format!(
        "    <service_port>\n      <name>{}</name>\n      <usage>{}</usage>\n      <type>{}</type>{}\n      \
         <description>{}</description>\n      {settings}\n    </service_port>\n",
        port.name,
        usage(port),
        escape(service.map_or_else(|| call_type(port), str::to_owned).as_str()),
        reference.unwrap_or_default(),
        escape(description)
    )
}

/// The queue of a client without a handler is never used.
fn event_port(port: &PortDecl) -> String {
    let size = if port.fifo > 0 { port.fifo } else { FIFO_SIZE_DEFAULT };
    let queue = format!("\n      <queue_size>{size}</queue_size>");
    let settings = match (port.pattern, port.direction) {
        (_, Direction::Output) => String::new(),
        (Pattern::Event, Direction::Input) => {
            let (timeout, queue) = (quantity::format_duration(WAIT), if port.handler { queue.as_str() } else { "" });
            format!(
                "{queue}\n      <activations>{ACTIVATIONS_DEFAULT}</activations>\n      <timeout>{timeout}</timeout>"
            )
        }
        (_, Direction::Input) => queue,
    };
    format!(
        "    <event_port>\n      <name>{}</name>\n      <description>{}</description>\n      <usage>{}</usage>\n      \
         <data_type>{}</data_type>{settings}\n    </event_port>\n",
        port.name,
        escape(port.description.as_str()),
        usage(port),
        port.object.name
    )
}

/// What is asked and what is answered, or what is sent, as the name of an interface.
fn call_type(port: &PortDecl) -> String {
    match port.answer.into_option() {
        Some(answer) => format!("{} to {}", port.object.name, answer.name),
        None => port.object.name.to_string(),
    }
}

fn usage(port: &PortDecl) -> &'static str {
    match (port.pattern, port.direction) {
        (Pattern::Query | Pattern::Send, Direction::Input) => "provided",
        (Pattern::Query | Pattern::Send, Direction::Output) => "required",
        (Pattern::Push | Pattern::Event | Pattern::EventPort, Direction::Input) => "input",
        (Pattern::Push | Pattern::Event | Pattern::EventPort, Direction::Output) => "output",
    }
}

fn data_port(port: &PortDecl) -> String {
    let usage = usage(port);
    let queue = match (port.direction, port.fifo) {
        (Direction::Input, _) if port.push.end == PushEnd::Push => {
            let timeout = quantity::format_duration(WAIT);
            format!("\n      <queueing_policy>LAST</queueing_policy>\n      <timeout>{timeout}</timeout>")
        }
        (Direction::Output, _) if port.push != PushDecl::DATA => cycle(&port.push),
        (Direction::Output, _) => String::new(),
        (Direction::Input, 0) => "\n      <queueing_policy>LAST</queueing_policy>".into(),
        (Direction::Input, size) => {
            format!("\n      <queueing_policy>FIFO</queueing_policy>\n      <queue_size>{size}</queue_size>")
        }
    };
    format!(
        "    <data_port>\n      <name>{}</name>\n      <description>{}</description>\n      <usage>{usage}</usage>\n      \
         <data_type>{}</data_type>{queue}\n    </data_port>\n",
        port.name,
        escape(port.description.as_str()),
        port.object.name
    )
}

/// What the class says of its cycle.
fn cycle(push: &PushDecl) -> String {
    let element = |name: &str, nanos: u64| match nanos {
        0 => String::new(),
        nanos => {
            let time = quantity::format_duration(Duration::from_nanos(nanos));
            format!("\n      <{name}>{time}</{name}>")
        }
    };
    element("period", push.period_ns) + &element("min_cycle", push.min_cycle_ns)
}

fn push(push: &PushDecl) -> Value {
    let end = match push.end {
        PushEnd::Data => "data",
        PushEnd::Push => "push",
        PushEnd::Timed => "timed",
    };
    json!({"end": end, "period_ns": push.period_ns, "started": push.started, "min_cycle_ns": push.min_cycle_ns,
        "handler_prescale": push.prescale})
}

/// The objects of the ports as an OPRoS `data_type`, each once.
fn data_types(ports: &[PortDecl]) -> String {
    let mut seen: Vec<&TypeDescriptor> = Vec::new();
    for port in ports {
        collect(port.object, &mut seen);
        port.answer.into_option().into_iter().for_each(|answer| collect(answer, &mut seen));
    }
    if seen.is_empty() {
        return String::new();
    }
    let structs: String = seen.iter().map(|object| structure(object)).collect();
    format!("<!-- The objects that its ports carry:\n<data_type>\n{structs}</data_type>\n-->\n")
}

fn collect<'a>(object: &'a TypeDescriptor, seen: &mut Vec<&'a TypeDescriptor>) {
    object.fields.iter().for_each(|field| collect(field.object, seen));
    if let Some(element) = object.element() {
        collect(element, seen);
    }
    if object.kind == Kind::Struct
        && seen.iter().all(|known| known.layout_hash != object.layout_hash || known.name != object.name)
    {
        seen.push(object);
    }
}

fn structure(object: &TypeDescriptor) -> String {
    let mut text = format!("  <struct name=\"{}\">\n", object.name);
    for field in object.fields.iter() {
        let _ = writeln!(text, "    <item type=\"{}\">{}</item>", escape(type_name(field.object).as_str()), field.name);
    }
    text.push_str("  </struct>\n");
    text
}

fn object(class: &Class) -> Value {
    let decl = &class.exported().decl;
    let plugin = class.plugin();
    let ports: Vec<Value> = decl
        .ports
        .iter()
        .map(|port| {
            let mut described = json!({"name": port.full_name(), "usage": usage(port),
            "object": port.object.name.as_str(), "size": port.object.size, "fifo": port.fifo,
            "layout": format!("{:016x}", port.object.layout_hash), "description": port.description.as_str()});
            if !port.service.is_empty() {
                described["service"] = json!(port.service.as_str());
            }
            if port.push != PushDecl::DATA {
                described["push"] = push(&port.push);
            }
            if let Some(answer) = port.answer.into_option() {
                described["answer"] = json!(answer.name.as_str());
                described["answer_size"] = json!(answer.size);
                described["answer_layout"] = json!(format!("{:016x}", answer.layout_hash));
            }
            described
        })
        .collect();
    let properties: Vec<Value> = decl.properties.iter().map(|property| {
        json!({"name": property.name.as_str(), "type": property.kind.opros_name(), "default": property.default.as_str(),
            "unit": property.unit.as_str(), "min": finite(property.min), "max": finite(property.max),
            "description": property.description.as_str()})
    }).collect();
    let trigger = match decl.trigger {
        TriggerDecl::Periodic { period_ns } => json!({"type": "periodic", "period_ns": period_ns}),
        TriggerDecl::Nonperiodic => json!({"type": "nonperiodic"}),
        TriggerDecl::Passive => json!({"type": "passive"}),
    };
    let critical: Vec<Value> =
        decl.criticals.iter().map(|field| json!({"name": field.name.as_str(), "size": field.size})).collect();
    json!({"class": class.name(), "version": decl.version.as_str(), "description": decl.description.as_str(),
        "plugin": plugin.file, "build": plugin.header.build, "build_id": plugin.image.build_id,
        "sdk_version": plugin.header.sdk_version, "trigger": trigger, "ports": ports, "properties": properties,
        "critical": critical})
}

/// JSON has no infinity: an open bound is null.
fn finite(bound: f64) -> Value {
    if bound.is_finite() { json!(bound) } else { Value::Null }
}
