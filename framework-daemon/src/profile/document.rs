//! One file: source, tree, vocabulary, extraction; whatever its root is.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::application::{self, Assembly};
use super::component::{self, ComponentProfile};
use super::conform::conform;
use super::data_type::{self, Struct};
use super::diagnostic::{Diagnostic, Reporter};
use super::service_type::{self, Interface};
use super::source::Source;
use super::suggest;
use super::system::{self, SystemProfile};
use super::vocabulary::{LEGACY_ROOTS, ROOTS};
use super::xml::{self, Element};

/// One file with everything that was found in it.
#[derive(Clone, Debug)]
pub struct Document {
    /// Its path, as it was named.
    pub path: Arc<PathBuf>,
    /// Name of its root element; empty where it could not be read.
    pub root: String,
    /// What was extracted, also from a file with errors.
    pub profile: Option<Profile>,
    /// What was found.
    pub findings: Vec<Diagnostic>,
}

/// What a file holds.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Profile {
    /// `component_profile`.
    Component(ComponentProfile),
    /// `application_profile` or `package_profile`.
    Application(Assembly),
    /// `composite_component_profile`.
    Composite(Assembly),
    /// `system_profile`.
    System(SystemProfile),
    /// `data_type`.
    DataTypes {
        /// Its structures.
        structs: Vec<Struct>,
    },
    /// `service_port_type_profile`.
    ServiceTypes {
        /// Its interfaces.
        interfaces: Vec<Interface>,
    },
    /// A file of OPRoS's engine or editors: accepted, nothing in it is used.
    Legacy {
        /// Its name, if it has one.
        name: String,
    },
}

impl Document {
    /// Reads the file at `path`.
    #[must_use]
    pub fn read(path: &Path) -> Self {
        match Source::read(path) {
            Ok(source) => Self::of_source(source),
            Err(finding) => Self::unreadable(path, vec![finding]),
        }
    }

    /// Reads `bytes` as the content of `path`.
    #[must_use]
    pub fn of_bytes(path: &Path, bytes: &[u8]) -> Self {
        match Source::decode(path, bytes) {
            Ok(source) => Self::of_source(source),
            Err(finding) => Self::unreadable(path, vec![finding]),
        }
    }

    /// True where nothing in the file is an error.
    #[must_use]
    pub fn accepted(&self) -> bool {
        !self.findings.iter().any(Diagnostic::is_error)
    }

    /// A period that is missing, where nothing outside this file could state one.
    #[must_use]
    pub fn missing_period(&self) -> Option<&Diagnostic> {
        match &self.profile {
            Some(Profile::Component(component)) => component.missing_period.as_deref(),
            _ => None,
        }
    }

    fn unreadable(path: &Path, findings: Vec<Diagnostic>) -> Self {
        Self { path: Arc::new(path.to_path_buf()), root: String::new(), profile: None, findings }
    }

    fn of_source(source: Source) -> Self {
        let source = Arc::new(source);
        let path = Arc::clone(source.path());
        match xml::parse(&source) {
            Ok(mut root) => {
                let mut report = Reporter::new(Arc::clone(&source));
                let profile = extract(&mut root, &path, &mut report);
                Self { path, root: root.name, profile, findings: report.into_findings() }
            }
            Err(findings) => Self::unreadable(&path, findings),
        }
    }
}

fn extract(root: &mut Element, path: &Path, report: &mut Reporter) -> Option<Profile> {
    if LEGACY_ROOTS.contains(&root.name.as_str()) {
        report.note(root.name_span, format!("<{}> belongs to OPRoS's engine or editor", root.name)).hint =
            Some("it is accepted, and nothing in it is used".to_owned());
        return Some(Profile::Legacy { name: root.text_of("name").to_owned() });
    }
    let exact = ROOTS.iter().find(|rule| rule.name == root.name);
    let Some(rule) = exact.or_else(|| ROOTS.iter().find(|rule| rule.name.eq_ignore_ascii_case(&root.name))) else {
        unknown_root(root, report);
        return None;
    };
    if rule.name != root.name {
        report.warning(root.name_span, format!("<{}> is written <{}>", root.name, rule.name));
        rule.name.clone_into(&mut root.name);
    }
    conform(root, rule, report);
    Some(match rule.name {
        "component_profile" => Profile::Component(component::read(root, report)),
        "composite_component_profile" => Profile::Composite(application::read(root, report)),
        "system_profile" => Profile::System(system::read(root, path, report)),
        "data_type" => Profile::DataTypes { structs: data_type::read(root, report) },
        "service_port_type_profile" => Profile::ServiceTypes { interfaces: service_type::read(root, report) },
        _ => Profile::Application(application::read(root, report)),
    })
}

fn unknown_root(root: &Element, report: &mut Reporter) {
    let names: Vec<&str> = ROOTS.iter().map(|rule| rule.name).collect();
    let hint = suggest::hint(&root.name, &names, |name| format!("<{name}>"));
    report.error(root.name_span, format!("<{}> is not the root of a profile", root.name)).hint = hint;
}
