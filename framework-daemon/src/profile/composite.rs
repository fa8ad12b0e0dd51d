//! `composite_component_profile`: the ports of inner slots that show outside. The rest is an assembly like any other.

use serde::Serialize;

use super::application::port_kind;
use super::diagnostic::Reporter;
use super::plan::{PortKind, PortRef};
use super::source::Word;
use super::xml::Element;

/// An exported port as written.
#[derive(Clone, Debug, Serialize)]
pub struct Export {
    /// Inner slot.
    pub component: Word,
    /// Its port.
    pub port: Word,
    /// Its kind, if stated.
    pub kind: Option<PortKind>,
    /// Its direction, if stated: `input`, `output`, `provided`, `required`.
    pub direction: Word,
    /// Its name outside.
    pub name: Word,
}

/// A composite: at run time only names are left of it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct CompositePlan {
    /// Its name: `head`, or `outer.head`.
    pub name: String,
    /// Name of its profile.
    pub profile: String,
    /// Its application.
    pub application: String,
    /// The slots in it.
    pub slots: Vec<String>,
    /// Its exported ports, each with the slot's port that it is; an input that feeds several is there several times.
    pub exports: Vec<(String, PortRef)>,
}

/// Reads `<export_ports>`; empty for an application, which has none.
pub fn exports(root: &Element, report: &mut Reporter) -> Vec<Export> {
    root.grandchildren("export_ports", "export_port").filter_map(|element| export(element, report)).collect()
}

fn export(element: &Element, report: &Reporter) -> Option<Export> {
    let (component, port) = (element.child("component_name")?, element.child("port_name")?);
    let outside = element.child("export_port_name").filter(|name| !name.text.is_empty()).unwrap_or(port);
    Some(Export {
        component: report.text_word(component),
        port: report.text_word(port),
        kind: port_kind(element.text_of("port_type")),
        direction: report.text_word(element.child("port_dir").unwrap_or(&Element::default())),
        name: report.text_word(outside),
    })
    .filter(|export| !export.component.text.is_empty() && !export.port.text.is_empty())
}
