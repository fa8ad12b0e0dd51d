//! The interface that a profile states of a service port, compared with the one of the plugin's class.
//!
//! OPRoS names C++ types. Those that mean an object here are compared; of any other the author alone knows whether it is
//! the same, so that it is a warning. Where a file that a profile refers to is not there nothing is compared: of the shipped
//! profiles every second reference leads nowhere.

use std::path::Path;

use component_sdk::abi::class::{Pattern, PortDecl};
use component_sdk::object::{Kind, TypeDescriptor};

use super::wiring::at;
use crate::plugin::Class;
use crate::plugin::interface::{methods, type_name};
use crate::profile::document::{Document, Profile};
use crate::profile::plan::{ComponentPlan, Location, ServicePortPlan};
use crate::profile::service_type::{Interface, Method};

/// What was found, as `file:line:column: …`.
#[derive(Debug, Default)]
pub struct Findings {
    /// Differences.
    pub errors: Vec<String>,
    /// What may be one.
    pub warnings: Vec<String>,
}

impl Findings {
    fn error(&mut self, location: &Location, text: &str) {
        self.errors.push(at(location, text));
    }

    fn warning(&mut self, location: &Location, text: &str) {
        self.warnings.push(at(location, text).replacen(": error: ", ": warning: ", 1));
    }
}

/// Compares the interfaces of all service ports of a component.
#[must_use]
pub fn compare(component: &ComponentPlan, class: &Class) -> Findings {
    let mut findings = Findings::default();
    for port in component.service_ports.iter().filter(|port| !port.reference.is_empty()) {
        let file = component.location.file.parent().unwrap_or(Path::new("")).join(port.reference.replace('\\', "/"));
        if file.is_file() {
            compare_with_file(port, &file, class.exported().decl.ports.as_slice(), &mut findings);
        }
    }
    findings
}

fn compare_with_file(port: &ServicePortPlan, file: &Path, ports: &[PortDecl], findings: &mut Findings) {
    let document = Document::read(file);
    let Some(Profile::ServiceTypes { interfaces }) = &document.profile else {
        let text = format!("{} is no readable service_port_type_profile", file.display());
        return findings.error(&port.location, &text);
    };
    let plugins: Vec<&PortDecl> = methods(ports, &port.name).collect();
    if plugins.is_empty() {
        let text =
            format!("port `{}` is a single query or message in the plugin: its interface is not compared", port.name);
        return findings.warning(&port.location, &text);
    }
    let named = |interface: &&Interface| interface.name.eq_ignore_ascii_case(&port.type_name);
    let Some(interface) = interfaces.iter().find(named) else {
        let known: Vec<_> = interfaces.iter().map(|interface| interface.name.as_str()).collect();
        let text = format!("{} has no interface `{}`; it has: {}", file.display(), port.type_name, known.join(", "));
        return findings.error(&port.location, &text);
    };
    compare_names(port, interface, &plugins, findings);
    compare_methods(interface, &plugins, findings);
}

fn compare_names(port: &ServicePortPlan, interface: &Interface, plugins: &[&PortDecl], findings: &mut Findings) {
    let service = plugins.first().map_or("", |plugin| plugin.service.as_str());
    for name in [&interface.name, &port.type_name] {
        if name != service {
            let text = format!("interface `{name}` is called `{service}` in the plugin: its methods decide");
            return findings.warning(&port.location, &text);
        }
    }
}

fn compare_methods(interface: &Interface, plugins: &[&PortDecl], findings: &mut Findings) {
    for method in &interface.methods {
        match counterpart(method, plugins) {
            Some(plugin) => compare_method(method, plugin, findings),
            None => {
                let known: Vec<_> = plugins.iter().map(|plugin| plugin.method.as_str()).collect();
                let text = format!("the plugin has no method `{}`; it has: {}", method.name, known.join(", "));
                findings.error(&method.location, &text);
            }
        }
    }
    let is_stated = |plugin: &&&PortDecl| {
        interface.methods.iter().any(|method| method.name.eq_ignore_ascii_case(plugin.method.as_str()))
    };
    for missing in plugins.iter().filter(|plugin| !is_stated(plugin)) {
        findings.error(&interface.location, &format!("method `{}` of the plugin is missing", missing.method));
    }
}

/// The plugin's method of that name; where there is none, the one whose name differs in case only.
fn counterpart<'a>(method: &Method, plugins: &[&'a PortDecl]) -> Option<&'a PortDecl> {
    let exact = plugins.iter().find(|plugin| plugin.method.as_str() == method.name);
    let near = || plugins.iter().find(|plugin| plugin.method.as_str().eq_ignore_ascii_case(&method.name));
    exact.or_else(near).copied()
}

fn compare_method(method: &Method, plugin: &PortDecl, findings: &mut Findings) {
    let (name, location) = (&method.name, &method.location);
    if plugin.method.as_str() != name {
        let text = format!("method `{name}` is called `{}` in the plugin: only the case differs", plugin.method);
        findings.warning(location, &text);
    }
    if method.blocking != (plugin.pattern == Pattern::Query) {
        let [stated, found] =
            [method.blocking, !method.blocking].map(|blocking| if blocking { "blocking" } else { "nonblocking" });
        findings.error(location, &format!("method `{name}` is {found} in the plugin, not {stated}"));
    }
    let parameters = plugin.object.fields.as_slice();
    if method.parameters.len() != parameters.len() {
        let (stated, found) = (method.parameters.len(), parameters.len());
        return findings
            .error(location, &format!("method `{name}` has {found} parameters in the plugin, not {stated}"));
    }
    for ((stated, parameter), found) in method.parameters.iter().zip(parameters) {
        compare_type(
            stated,
            Some(found.object),
            &format!("parameter `{parameter}` of method `{name}`"),
            location,
            findings,
        );
    }
    let result = plugin.answer.into_option();
    compare_type(&method.return_type, result, &format!("the result of method `{name}`"), location, findings);
}

fn compare_type(
    stated: &str,
    found: Option<&TypeDescriptor>,
    what: &str,
    location: &Location,
    findings: &mut Findings,
) {
    let name = found.map_or_else(|| "void".to_owned(), type_name);
    match fits(stated, found) {
        Some(true) => {}
        Some(false) => findings.error(location, &format!("{what} is {name} in the plugin, not {stated}")),
        None => {
            let text = format!("{what}: whether {stated} is what the plugin has, {name}, is not known");
            findings.warning(location, &text);
        }
    }
}

/// Whether a C++ type is that object; `None`: nobody knows.
fn fits(stated: &str, found: Option<&TypeDescriptor>) -> Option<bool> {
    let stated = stated.trim();
    let stated = stated.strip_prefix("const ").unwrap_or(stated).trim_end_matches(['&', ' ']);
    if stated == "void" {
        return Some(found.is_none_or(|object| object.size == 0));
    }
    let Some(found) = found else { return Some(false) };
    if type_name(found) == stated {
        return Some(true);
    }
    if let Some(kind) = kind(stated) {
        return Some(found.kind == kind);
    }
    let bare = stated.strip_prefix("std::").unwrap_or(stated);
    let inner = bare.strip_prefix("vector")?.trim().strip_prefix('<')?.strip_suffix('>')?;
    if found.kind != Kind::Sequence {
        return Some(false);
    }
    fits(inner, found.element())
}

/// What a scalar or text of C++ is here (LP64).
fn kind(stated: &str) -> Option<Kind> {
    Some(match stated {
        "bool" => Kind::Bool,
        "char" | "signed char" | "int8_t" => Kind::I8,
        "unsigned char" | "uint8_t" => Kind::U8,
        "short" | "short int" | "int16_t" => Kind::I16,
        "unsigned short" | "unsigned short int" | "uint16_t" => Kind::U16,
        "int" | "signed int" | "int32_t" => Kind::I32,
        "unsigned int" | "unsigned" | "uint32_t" => Kind::U32,
        "long" | "long int" | "long long" | "int64_t" => Kind::I64,
        "unsigned long" | "unsigned long int" | "unsigned long long" | "uint64_t" | "size_t" => Kind::U64,
        "float" => Kind::F32,
        "double" => Kind::F64,
        "string" | "std::string" => Kind::Text,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use component_sdk::object::{CommObject, Sequence, Text};
    use component_sdk::objects::Pose2D;

    use super::*;

    #[test]
    fn types_of_cxx_are_held_against_objects() {
        let known: &[(&str, &TypeDescriptor, Option<bool>)] = &[
            ("double", f64::DESCRIPTOR, Some(true)),
            ("float", f64::DESCRIPTOR, Some(false)),
            ("int", i32::DESCRIPTOR, Some(true)),
            ("unsigned long", u64::DESCRIPTOR, Some(true)),
            ("const std::string &", Text::DESCRIPTOR, Some(true)),
            ("string", f64::DESCRIPTOR, Some(false)),
            ("void", <()>::DESCRIPTOR, Some(true)),
            ("void", f64::DESCRIPTOR, Some(false)),
            ("std::vector<double>", Sequence::<f64>::DESCRIPTOR, Some(true)),
            ("vector <double>", Sequence::<f64>::DESCRIPTOR, Some(true)),
            ("vector<float>", Sequence::<f64>::DESCRIPTOR, Some(false)),
            ("vector<double>", f64::DESCRIPTOR, Some(false)),
            ("vector< vector<unsigned char> >", Sequence::<Sequence<u8>>::DESCRIPTOR, Some(true)),
            ("vector<Skeleton>", Sequence::<Pose2D>::DESCRIPTOR, None),
            ("Pose2D", Pose2D::DESCRIPTOR, Some(true)),
            ("ObjectLocation", Pose2D::DESCRIPTOR, None),
            ("double[3]", <[f64; 3]>::DESCRIPTOR, Some(true)),
        ];
        for (stated, found, fits) in known {
            assert_eq!(self::fits(stated.trim(), Some(found)), *fits, "{stated} and {}", type_name(found));
        }
        assert_eq!((fits("void", None), fits("int", None)), (Some(true), Some(false)));
    }
}
