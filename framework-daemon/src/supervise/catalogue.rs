//! Classes by name: libraries found in the plugin directories, loaded once, checked against the profile.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use component_sdk::abi::class::{Direction, Pattern};

use super::interfaces;
use crate::plugin::library::{self, Stamp};
use crate::plugin::{Class, Plugin, discover, probe};
use crate::port::border::HOST;
use crate::profile::plan::{ComponentPlan, Usage};

/// A file at a moment: a rebuilt plugin is another one.
type Key = (PathBuf, Stamp);

/// A plugin, or why it was refused.
type Loaded = Result<Arc<Plugin>, String>;

/// All plugins of the process.
#[derive(Clone, Default)]
pub struct Catalogue {
    directories: Vec<PathBuf>,
    loaded: Arc<Mutex<HashMap<Key, Loaded>>>,
    /// What another process survived, or why not.
    probed: Arc<Mutex<HashMap<Key, Result<(), String>>>>,
    /// Each told once.
    warnings: Arc<Mutex<Vec<String>>>,
}

impl Catalogue {
    /// The same plugins, searched in other directories.
    #[must_use]
    pub fn in_directories(&self, directories: Vec<PathBuf>) -> Self {
        Self { directories, ..self.clone() }
    }

    /// The class that a component profile names, checked against it.
    ///
    /// # Errors
    /// In words: no such library, refused, no such class, other ports.
    pub fn class(&self, component: &ComponentPlan) -> Result<Class, String> {
        let location = &component.location;
        let place = format!("{}:{}:{}", location.file.display(), location.line, location.column);
        let class = self.find(component);
        let class = class.map_err(|reason| format!("{place}: error: component `{}`: {reason}", component.name))?;
        self.check_interfaces(component, &class)?;
        Ok(class)
    }

    fn find(&self, component: &ComponentPlan) -> Result<Class, String> {
        let file = self.file(component).ok_or_else(|| self.not_found(&component.library))?;
        let plugin = self.plugin(&file)?;
        let class = plugin.class(&component.name).ok_or_else(|| {
            let known: Vec<_> = plugin.classes().iter().map(Class::name).collect();
            format!("plugin {} exports no such class; it has: {}", file.display(), known.join(", "))
        })?;
        check_ports(component, &class)?;
        check_properties(component, &class)?;
        Ok(class)
    }

    /// Holds the interfaces that the profile states against those of the class.
    fn check_interfaces(&self, component: &ComponentPlan, class: &Class) -> Result<(), String> {
        let findings = interfaces::compare(component, class);
        let mut told = self.warnings.lock().unwrap_or_else(PoisonError::into_inner);
        for warning in findings.warnings {
            // A class is looked up for each of its slots, and at each reload.
            if !told.contains(&warning) {
                tracing::warn!("{warning}");
                told.push(warning);
            }
        }
        if findings.errors.is_empty() { Ok(()) } else { Err(findings.errors.join("\n")) }
    }

    /// What was not right with the profiles of the classes that were looked up, and no error.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sees to it that the component's plugin can be loaded later without another look: for `preload="none"`.
    ///
    /// # Errors
    /// In words: no such library, or loading it ends the process that does it.
    pub fn foresee(&self, component: &ComponentPlan) -> Result<(), String> {
        let file = self.file(component).ok_or_else(|| self.not_found(&component.library))?;
        self.probe(&file)
    }

    fn probe(&self, file: &Path) -> Result<(), String> {
        let mut probed = self.probed.lock().unwrap_or_else(PoisonError::into_inner);
        let survive =
            || probe::survive(file).map_err(|reason| format!("plugin {} is refused: {reason}", file.display()));
        probed.entry(key(file)?).or_insert_with(survive).clone()
    }

    fn file(&self, component: &ComponentPlan) -> Option<PathBuf> {
        let beside = component.location.file.parent().map(Path::to_owned);
        let mut directories = self.directories.clone();
        directories.extend(beside);
        discover::find(&component.library, &directories)
    }

    fn not_found(&self, library: &str) -> String {
        let names = discover::candidates(library).join(", ");
        let places: Vec<_> = self.directories.iter().map(|directory| directory.display().to_string()).collect();
        format!(
            "no plugin for library_name `{library}`: looked for {names} in {} and beside the profile; \
             name its directory by `--plugins DIR` or `<plugins>` in the system profile",
            if places.is_empty() { "no plugin directory".into() } else { places.join(", ") }
        )
    }

    fn plugin(&self, file: &Path) -> Result<Arc<Plugin>, String> {
        self.probe(file)?;
        let key = key(file)?;
        let mut loaded = self.loaded.lock().unwrap_or_else(PoisonError::into_inner);
        // Refusals are kept too: a library is never closed, so each try would cost its memory.
        let load = || {
            let plugin = Plugin::load(file, &HOST).map_err(|refusal| refusal.to_string())?;
            let (build, id) = (&plugin.header.build, &plugin.image.build_id);
            tracing::info!("loaded {} ({build}, build id {id})", file.display());
            Ok(plugin)
        };
        loaded.entry(key).or_insert_with(load).clone()
    }
}

fn key(file: &Path) -> Result<Key, String> {
    let stamp = library::stamp(file).map_err(|error| format!("{}: {error}", file.display()))?;
    Ok((file.to_owned(), stamp))
}

/// Every port of the profile must be one of the class, with the same direction. (Type names are the profile's; layouts
/// are compared at connection.)
fn check_ports(component: &ComponentPlan, class: &Class) -> Result<(), String> {
    for port in &component.data_ports {
        let wanted = if port.usage == Usage::Input { Direction::Input } else { Direction::Output };
        check_port(class, &port.name, Pattern::Push, wanted)?;
    }
    for port in &component.event_ports {
        let wanted = if port.usage == Usage::Input { Direction::Input } else { Direction::Output };
        check_port(class, &port.name, Pattern::Event, wanted)?;
    }
    for port in &component.service_ports {
        let wanted = if port.provided { Direction::Input } else { Direction::Output };
        check_port(class, &port.name, Pattern::Query, wanted)?;
    }
    Ok(())
}

fn check_port(class: &Class, name: &str, pattern: Pattern, direction: Direction) -> Result<(), String> {
    let ports = class.exported().decl.ports;
    let Some(found) = ports.iter().find(|candidate| candidate.name.as_str() == name) else {
        let mut known: Vec<_> = ports.iter().map(|port| port.name.as_str()).collect();
        // A service port has as many as methods.
        known.dedup();
        return Err(format!("the plugin's class has no port `{name}`; it has: {}", known.join(", ")));
    };
    if element(found.pattern) != element(pattern) {
        let (is, wanted) = (element(found.pattern), element(pattern));
        return Err(format!("port `{name}` is {is} in the plugin, not {wanted}"));
    }
    if found.direction == direction {
        return Ok(());
    }
    let sides = match pattern {
        Pattern::Push | Pattern::Event | Pattern::EventPort => "has the other direction in the plugin",
        Pattern::Query | Pattern::Send if found.direction == Direction::Input => {
            "is provided by the plugin, not required"
        }
        Pattern::Query | Pattern::Send => "is required by the plugin, not provided",
    };
    Err(format!("port `{name}` {sides}"))
}

/// What a profile calls a port of that pattern.
const fn element(pattern: Pattern) -> &'static str {
    match pattern {
        Pattern::Push => "a <data_port>",
        Pattern::Query | Pattern::Send => "a <service_port>",
        Pattern::Event | Pattern::EventPort => "an <event_port>",
    }
}

fn check_properties(component: &ComponentPlan, class: &Class) -> Result<(), String> {
    let decl = &class.exported().decl;
    let unknown =
        component.properties.iter().find(|p| decl.properties.iter().all(|known| known.name.as_str() != p.name));
    unknown.map_or(Ok(()), |property| {
        let known: Vec<_> = decl.properties.iter().map(|property| property.name.as_str()).collect();
        Err(format!("the plugin's class has no property `{}`; it has: {}", property.name, known.join(", ")))
    })
}
