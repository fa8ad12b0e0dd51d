//! `service_port_type_profile`: interfaces of service ports.

use std::collections::HashSet;

use serde::Serialize;

use super::diagnostic::Reporter;
use super::plan::Location;
use super::xml::Element;

/// An interface.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Interface {
    /// Its type name.
    pub name: String,
    /// Its methods, in order.
    pub methods: Vec<Method>,
    /// Where it was declared.
    #[serde(skip)]
    pub location: Location,
}

/// A method.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Method {
    /// Its name.
    pub name: String,
    /// Type of its result.
    pub return_type: String,
    /// False for `nonblocking`.
    pub blocking: bool,
    /// Its parameters, in order: type and name.
    pub parameters: Vec<(String, String)>,
    /// Where it was declared.
    #[serde(skip)]
    pub location: Location,
}

/// Reads `<service_port_type_profile>`.
pub fn read(root: &Element, report: &mut Reporter) -> Vec<Interface> {
    root.children_of("service_port_type").map(|element| interface(element, report)).collect()
}

fn interface(element: &Element, report: &mut Reporter) -> Interface {
    let mut methods = Vec::new();
    let mut signatures = HashSet::new();
    for child in element.children_of("method") {
        let method = method(child, report);
        // Overloads are C++; the same name with the same parameters is a mistake.
        let types: Vec<String> = method.parameters.iter().map(|(kind, _)| kind.clone()).collect();
        if !signatures.insert((method.name.clone(), types)) {
            let word = report.value_word(child, "name");
            report.warning(word.spot.span, format!("method \"{}\" is already defined in this interface", method.name));
        }
        methods.push(method);
    }
    let name = element.text_of("type_name").to_owned();
    Interface { name, methods, location: report.location(element.name_span) }
}

fn method(element: &Element, report: &Reporter) -> Method {
    let parameter = |param: &Element| (param.text_of("type").to_owned(), param.text_of("name").to_owned());
    Method {
        name: element.value_of("name").to_owned(),
        return_type: element.value_of("return_type").to_owned(),
        blocking: element.value_of("call_type") != "nonblocking",
        parameters: element.children_of("param").map(parameter).collect(),
        location: report.location(element.name_span),
    }
}
