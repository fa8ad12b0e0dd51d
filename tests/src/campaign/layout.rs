//! The profiles of one run: the slots that are tortured on an executor of their own, twenty others on two more.

use super::classes::{Class, Course};
use crate::profiles::{Profiles, application, connection_of, plugin_dir, slot};

/// Slots that nobody tortures.
pub const OTHERS: usize = 20;

/// Deadline of the classes that have one: a callback that does nothing bad rarely loses its core for that long.
const DEADLINE: &str = "<deadline hang=\"20ms\">20ms</deadline></execution_semantics>";

/// Whatever happens, the slot is reset; far more often than it can happen.
const RULES: &str = "<fault_tolerance><severity>reset</severity><severity symptom=\"hang\">reset</severity>\
                     <reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";

/// How the threads are scheduled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Time sharing.
    Other,
    /// Real time: the others above the tortured, as an integrator would have it.
    Fifo,
}

impl Policy {
    /// `other`, `fifo`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Other => "other",
            Self::Fifo => "fifo",
        }
    }

    fn system(self) -> String {
        let executor = |(name, priority): (&str, u32)| match self {
            Self::Other => format!("<executor name=\"{name}\"/>"),
            Self::Fifo => format!("<executor name=\"{name}\" policy=\"fifo\" priority=\"{priority}\"/>"),
        };
        let executors: String = [("rack", 50), ("left", 60), ("right", 60)].map(executor).concat();
        format!("<system_profile><name>campaign</name>{executors}</system_profile>")
    }
}

/// The directory of a run in which the class strikes `strikes` times.
///
/// # Panics
/// When the plugin cannot be described.
#[must_use]
pub fn profiles(class: &Class, strikes: usize, policy: Policy) -> Profiles {
    let profiles = Profiles::new(&app(class, strikes, true));
    profiles.describe(&plugin_dir().join("libtorture.so"));
    profiles.write("system.xml", &policy.system());
    if class.deadline {
        profiles.replace(&format!("{}.xml", class.component), "</execution_semantics>", DEADLINE);
    }
    profiles
}

/// The application, with the tortured slots or without.
#[must_use]
pub fn app(class: &Class, strikes: usize, tortured: bool) -> String {
    let count = match class.course {
        Course::Again | Course::Refused => 1,
        Course::OnceEach | Course::Leaving => strikes.max(1),
    };
    let victims = (0..if tortured { count } else { 0 }).map(|number| victim(class, number, strikes));
    let mut slots: Vec<String> = victims.collect();
    slots.extend((0..OTHERS).map(|number| other(number, class.neighbour)));
    let company =
        class.company.map(|(component, _)| slot(&format!("other{OTHERS}"), component, "<executor>rack</executor>"));
    slots.extend(company);
    let wires: Vec<String> = (1..OTHERS).map(|to| format!("other{}.said -> other{to}.heard", to - 1)).collect();
    let text = application(&slots, &wires.iter().map(String::as_str).collect::<Vec<_>>());
    match class.company.and_then(|(_, ports)| ports.split_once(" -> ")).filter(|_| tortured) {
        Some((ask, tell)) => {
            let link = connection_of("service", &format!("other{OTHERS}.{ask} -> victim0.{tell}"), "");
            text.replace("</port_connections>", &format!("{link}</port_connections>"))
        }
        None => text,
    }
}

fn victim(class: &Class, number: usize, strikes: usize) -> String {
    let how = property("how", "string", class.how);
    let after = match class.course {
        // One after the other, and none before all are started.
        Course::OnceEach => property("after", "int", &(100 + number).to_string()),
        // A thread has time to start.
        Course::Again if class.group == "threads" => property("after", "int", "20"),
        _ => String::new(),
    };
    let how = if class.how.is_empty() { String::new() } else { how };
    // Without a reset there are no spares, which would strike, too, when they leave.
    let rules = if class.course == Course::Leaving { "" } else { RULES };
    let limit = property("limit", "int", &strikes.to_string());
    let inside = format!("<executor>rack</executor><properties>{limit}{how}{after}</properties>{rules}");
    slot(&format!("victim{number}"), class.component, &inside)
}

fn other(number: usize, neighbour: bool) -> String {
    let executor = match number {
        0 if neighbour => "rack",
        _ if number.is_multiple_of(2) => "left",
        _ => "right",
    };
    slot(&format!("other{number}"), "Bystander", &format!("<executor>{executor}</executor>"))
}

fn property(name: &str, kind: &str, value: &str) -> String {
    format!("<property name=\"{name}\" type=\"{kind}\">{value}</property>")
}
