//! A robot with three sonars and a voter over them, for tests of what follows where too few agree.

use serde_json::Value;
use tempfile::TempDir;

use crate::asking::ask;
use crate::profiles::{Profiles, application, plugin_dir, slot};
use crate::running::Running;

/// Their slots.
pub const SONARS: [&str; 3] = ["left", "middle", "right"];

/// Three sonars that measure as these scripts say, with rules of their own, a voter called `sonar`, and whatever else.
///
/// # Panics
/// When the profiles cannot be written.
#[must_use]
pub fn robot(scripts: [&str; 3], rules: &str, voting: &str, slots: &[String], connections: &[&str]) -> Profiles {
    let sonar = |(name, script): (&str, &str)| {
        let properties =
            format!("<properties><property name=\"script\" type=\"std::string\">{script}</property></properties>");
        slot(name, "Wave", &(properties + rules))
    };
    let mut all: Vec<String> = SONARS.into_iter().zip(scripts).map(sonar).collect();
    all.extend(slots.iter().cloned());
    let profiles = Profiles::new(&application(&all, connections));
    for plugin in ["libsignals.so", "libhostile.so"] {
        profiles.describe(&plugin_dir().join(plugin));
    }
    let voting = format!(
        "<voting name=\"sonar\" inputs=\"left middle right\" field=\"distance\" tolerance=\"5\" {voting}</voting>\n\
         </application_profile>"
    );
    profiles.replace("app.xml", "</application_profile>", &voting);
    profiles
}

/// Has a slot depend on others.
///
/// # Panics
/// When the application cannot be written.
pub fn needs(profiles: &Profiles, component: &str, on: &str) {
    let text = format!("<dependency component=\"{component}\" on=\"{on}\"/>\n</application_profile>");
    profiles.replace("app.xml", "</application_profile>", &text);
}

/// Entries of the journal of that kind about that slot.
#[must_use]
pub fn of(daemon: &Running, kind: &str, slot: &str) -> Vec<Value> {
    daemon.entries(kind).into_iter().filter(|entry| entry["slot"] == slot).collect()
}

/// The fault that one comes of, or its own number: where a member leaps before the others, it is outvoted first.
#[must_use]
pub fn root(fault: &Value) -> Value {
    let cause = &fault["diagnosis"]["consequence_of"];
    if cause.is_null() { fault["seq"].clone() } else { cause.clone() }
}

/// State and reason of a slot.
///
/// # Panics
/// When the daemon does not answer, or has no such slot.
#[must_use]
pub fn state(daemon: &Running, slot: &str) -> (String, Option<String>) {
    let status = ask(daemon, "status --format json").json().remove(0);
    let found = status["slots"].as_array().unwrap().iter().find(|each| each["slot"] == slot).cloned().unwrap();
    (found["state"].as_str().unwrap().to_owned(), found["reason"].as_str().map(str::to_owned))
}

/// The voter as `status` shows it.
///
/// # Panics
/// When the daemon does not answer.
#[must_use]
pub fn voter(daemon: &Running) -> Value {
    ask(daemon, "status --format json").json().remove(0)["helpers"][0].clone()
}

/// The same, with brakes that write to lines of their own, and depend on the voter by nothing.
///
/// # Panics
/// When the profiles cannot be written.
#[must_use]
pub fn with_brakes(scripts: [&str; 3], place: &TempDir) -> Profiles {
    let brake = |name: &str| {
        let path = place.path().join(name).display().to_string();
        slot(
            name,
            "Brake",
            &format!("<properties><property name=\"line\" type=\"string\">{path}</property></properties>"),
        )
    };
    let slots = [brake("wheels"), brake("arm")];
    let profiles = robot(scripts, "", "max_age=\"300ms\"><severity symptom=\"vote\">emergency</severity>", &slots, &[]);
    profiles.write(
        "system.xml",
        "<system_profile><name>robot</name><emergency><actuator component=\"wheels\"/><actuator component=\"arm\"/>\
         </emergency></system_profile>",
    );
    profiles
}

/// What was written to that line.
#[must_use]
pub fn line(place: &TempDir, name: &str) -> Vec<String> {
    let text = std::fs::read_to_string(place.path().join(name)).unwrap_or_default();
    text.lines().map(str::to_owned).collect()
}
