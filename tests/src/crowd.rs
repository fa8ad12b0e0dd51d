//! A crowd of components in a real daemon, on two executors: they ask each other, wire each other and fail at random; when
//! they come to rest every question must have had its end.

use std::time::Duration;

use serde_json::Value;

use crate::profiles::{Profiles, application, plugin_dir, slot};
use crate::running::Running;

/// How many there are.
pub const MEMBERS: usize = 8;

const RULES: &str =
    "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";

/// What came of it.
#[derive(Debug)]
pub struct Crowd {
    /// Questions of the instances that were there at the end.
    pub asked: u64,
    /// Those that were answered.
    pub answered: u64,
    /// Values that came by a push.
    pub heard: u64,
    /// Faults on the way.
    pub faults: u64,
    /// All that was not right.
    pub problems: Vec<String>,
}

impl Crowd {
    /// In words.
    #[must_use]
    pub fn text(&self) -> String {
        let Self { asked, answered, heard, faults, problems } = self;
        format!("{asked} asked, {answered} answered, {heard} heard, {faults} faults; problems: {problems:?}")
    }
}

fn profiles(busy: Duration) -> Profiles {
    let slots = (0..MEMBERS).map(|number| {
        let executor = if number.is_multiple_of(2) { "left" } else { "right" };
        let property = |name: &str, value: u128| format!("<property name=\"{name}\" type=\"int\">{value}</property>");
        let properties = [
            property("me", number as u128),
            property("members", MEMBERS as u128),
            property("busy_ms", busy.as_millis()),
            property("traps", 20),
        ];
        let properties = properties.concat();
        let inside = format!("<executor>{executor}</executor><properties>{properties}</properties>{RULES}");
        slot(&format!("member{number}"), "Member", &inside)
    });
    let profiles = Profiles::new(&application(&slots.collect::<Vec<_>>(), &[]));
    profiles.describe(&plugin_dir().join("libqueries.so"));
    profiles.executors(&["left", "right"]);
    profiles
}

/// Lets them be busy for that long, and come to rest.
///
/// # Panics
/// When the daemon does not come up, or the crowd does not come to rest.
#[must_use]
pub fn run(busy: Duration) -> Crowd {
    let profiles = profiles(busy);
    let mut daemon = Running::start(profiles.path(), &[]);
    std::thread::sleep(busy);
    daemon.wait_for_lines("settled: ", MEMBERS);
    let slots = daemon.stop();
    let settled = daemon.lines("settled: ");
    let sum = |word: &str| settled.iter().filter_map(|line| number_before(line, word)).sum();
    let mut problems = daemon.lines("wrong: ");
    let strange = |fault: &Value| fault["symptom"] != "crash.segv" && fault["symptom"] != "overrun";
    problems.extend(daemon.entries("fault").iter().filter(|fault| strange(fault)).map(Value::to_string));
    problems.extend(slots.iter().filter(|slot| slot["state"] != "active").map(Value::to_string));
    let faults = slots.iter().filter_map(|slot| slot["faults"].as_u64()).sum();
    Crowd { asked: sum(" asked"), answered: sum(" answered"), heard: sum(" heard"), faults, problems }
}

/// `settled: 12 asked, 7 answered, 3 heard`.
fn number_before(line: &str, word: &str) -> Option<u64> {
    line.split(word).next()?.rsplit(' ').next()?.parse().ok()
}
