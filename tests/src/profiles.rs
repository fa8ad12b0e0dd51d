//! A profile directory of the basic test components, made from the plugin's own description.

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use crate::daemon_binary::daemon_binary;

/// A directory that is gone when the test ends.
pub struct Profiles(TempDir);

impl Profiles {
    /// Component profiles of every class of the basic plugin, and `application` as `app.xml`.
    ///
    /// # Panics
    /// When the plugin cannot be described.
    #[must_use]
    pub fn new(application: &str) -> Self {
        let profiles = Self(TempDir::new().expect("a temporary directory"));
        profiles.describe(&plugin_dir().join("libbasic.so"));
        profiles.write("app.xml", application);
        profiles
    }

    /// Adds the component profiles of a plugin.
    ///
    /// # Panics
    /// When it cannot be described.
    pub fn describe(&self, plugin: &Path) {
        let output = Command::new(daemon_binary()).arg("describe").arg(plugin).arg("--into").arg(self.path()).output();
        let output = output.expect("the daemon's binary runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }

    /// Writes a file.
    ///
    /// # Panics
    /// When it cannot be written.
    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path().join(name), text).expect("the directory is writable");
    }

    /// A system with executors of these names, as the system wants them.
    pub fn executors(&self, names: &[&str]) {
        let executors: String = names.iter().map(|name| format!("<executor name=\"{name}\"/>")).collect();
        self.write("system.xml", &format!("<system_profile><name>test</name>{executors}</system_profile>"));
    }

    /// Replaces text in a file.
    ///
    /// # Panics
    /// When the text is not there.
    pub fn replace(&self, name: &str, from: &str, to: &str) {
        let text = std::fs::read_to_string(self.path().join(name)).expect("the file is there");
        assert!(text.contains(from), "{name} does not contain {from}");
        self.write(name, &text.replacen(from, to, 1));
    }

    /// Replaces the first of a text in a file behind a place in it, as an element of one port of several.
    ///
    /// # Panics
    /// When place or text are not there.
    pub fn replace_after(&self, name: &str, place: &str, from: &str, to: &str) {
        let text = std::fs::read_to_string(self.path().join(name)).expect("the file is there");
        let (before, after) = text.split_once(place).unwrap_or_else(|| panic!("{name} does not contain {place}"));
        assert!(after.contains(from), "{name} does not contain {from} behind {place}");
        self.write(name, &format!("{before}{place}{}", after.replacen(from, to, 1)));
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.0.path()
    }
}

/// Where cargo put the plugins.
#[must_use]
pub fn plugin_dir() -> PathBuf {
    daemon_binary().parent().map(Path::to_path_buf).unwrap_or_default()
}

/// An application of these subcomponents and connections (`ticker.out -> relay.heard`).
#[must_use]
pub fn application(subcomponents: &[String], connections: &[&str]) -> String {
    let connections: String = connections.iter().map(|connection| written(connection)).collect();
    format!(
        "<application_profile>\n<name>test</name>\n<subcomponents>\n{}</subcomponents>\n<port_connections>\n\
         {connections}</port_connections>\n</application_profile>\n",
        subcomponents.concat()
    )
}

/// `ticker.out -> relay.heard` as a connection of data; what is XML already stays as it is.
fn written(connection: &str) -> String {
    if connection.starts_with('<') { connection.to_owned() } else { self::connection(connection, "") }
}

/// A connection, `ticker.out -> relay.heard`, with whatever belongs inside it.
///
/// # Panics
/// When it is not written that way.
#[must_use]
pub fn connection(ends: &str, inside: &str) -> String {
    connection_of("data", ends, inside)
}

/// A connection of that kind of ports.
///
/// # Panics
/// As [`connection`].
#[must_use]
pub fn connection_of(kind: &str, ends: &str, inside: &str) -> String {
    let (source, target) = ends.split_once(" -> ").expect("written as a.b -> c.d");
    let end = |tag: &str, end: &str| {
        let (slot, port) = end.split_once('.').expect("written as slot.port");
        format!("<{tag} component_name=\"{slot}\" port_name=\"{port}\"/>")
    };
    format!(
        "<port_connection port_type=\"{kind}\">{}{}{inside}</port_connection>\n",
        end("source", source),
        end("target", target)
    )
}

/// A subcomponent with whatever belongs inside it.
#[must_use]
pub fn slot(name: &str, class: &str, inside: &str) -> String {
    format!("<subcomponent><name>{name}</name><reference>{class}.xml</reference>{inside}</subcomponent>\n")
}
