//! A robot with two actuators, each of which writes to a line of its own, and a sensor.

use tempfile::TempDir;

use crate::profiles::{Profiles, application, plugin_dir, slot};

/// A crash is an emergency.
pub const RULES: &str = "<fault_tolerance><severity symptom=\"crash\">emergency</severity></fault_tolerance>";

/// Its profiles, and where its actuators write.
pub struct Robot {
    /// Its profiles.
    pub profiles: Profiles,
    /// A file for each actuator; others may lie beside them.
    pub lines: TempDir,
}

/// Slots `sensor` and `idle`, actuators `left` and `right`; `sensor`, `left`: what is in these slots' profiles besides.
///
/// # Panics
/// When the profiles cannot be written.
#[must_use]
pub fn robot(sensor: &str, left: &str) -> Robot {
    let lines = TempDir::new().expect("a directory");
    let brake = |name: &str, rules: &str| {
        let path = lines.path().join(name);
        let line =
            format!("<properties><property name=\"line\" type=\"string\">{}</property></properties>", path.display());
        slot(name, "Brake", &(line + rules))
    };
    let slots =
        [slot("sensor", "Witness", sensor), slot("idle", "Witness", ""), brake("left", left), brake("right", "")];
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.write(
        "system.xml",
        "<system_profile><name>robot</name><emergency><actuator component=\"left\"/><actuator component=\"right\"/>\
         </emergency></system_profile>",
    );
    Robot { profiles, lines }
}

impl Robot {
    /// What was written to an actuator's line.
    #[must_use]
    pub fn line(&self, name: &str) -> Vec<String> {
        let text = std::fs::read_to_string(self.lines.path().join(name)).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }
}
