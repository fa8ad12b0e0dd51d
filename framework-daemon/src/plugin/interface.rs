//! The interfaces of a class's service ports, as OPRoS writes them.

use std::fmt::Write as _;

use component_sdk::abi::class::{Pattern, PortDecl};
use component_sdk::object::{Kind, TypeDescriptor};
use quick_xml::escape::escape;

/// A type as an OPRoS profile names it.
#[must_use]
pub fn type_name(object: &TypeDescriptor) -> String {
    match (object.kind, object.element()) {
        (Kind::Sequence, Some(element)) => format!("std::vector<{}>", type_name(element)),
        (Kind::Array, Some(element)) => format!("{}[{}]", type_name(element), object.count),
        _ => object.name.to_string(),
    }
}

/// File name of an interface.
#[must_use]
pub fn file_name(service: &str) -> String {
    format!("{service}.service.xml")
}

/// The ports of the service port of that name, one for each method; none where it is a port of its own.
pub fn methods<'a>(ports: &'a [PortDecl], name: &str) -> impl Iterator<Item = &'a PortDecl> {
    ports.iter().filter(move |port| port.name.as_str() == name && !port.method.is_empty())
}

/// The interfaces of all service ports, by name: each once.
#[must_use]
pub fn interfaces(ports: &[PortDecl]) -> Vec<(String, String)> {
    let mut written: Vec<(String, String)> = Vec::new();
    for port in ports.iter().filter(|port| !port.method.is_empty()) {
        if written.iter().all(|(name, _)| name != port.service.as_str()) {
            let of_it: Vec<_> = methods(ports, port.name.as_str()).collect();
            written.push((port.service.to_string(), interface(port.service.as_str(), &of_it)));
        }
    }
    written
}

fn interface(name: &str, methods: &[&PortDecl]) -> String {
    let methods: String = methods.iter().map(|method| self::method(method)).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<service_port_type_profile>\n  <service_port_type>\n    \
         <type_name>{name}</type_name>\n{methods}  </service_port_type>\n</service_port_type_profile>\n"
    )
}

fn method(port: &PortDecl) -> String {
    let result = port.answer.into_option().map_or_else(|| "void".to_owned(), type_name);
    let call_type = if port.pattern == Pattern::Send { "nonblocking" } else { "blocking" };
    let mut text = format!(
        "    <method name=\"{}\" return_type=\"{}\" call_type=\"{call_type}\">\n",
        port.method,
        escape(result.as_str())
    );
    for (index, parameter) in (1..).zip(port.object.fields.iter()) {
        let object = type_name(parameter.object);
        let _ = writeln!(
            text,
            "      <param index=\"{index}\"><type>{}</type><name>{}</name></param>",
            escape(object.as_str()),
            parameter.name
        );
    }
    text.push_str("    </method>\n");
    text
}
