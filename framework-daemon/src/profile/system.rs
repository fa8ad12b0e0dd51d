//! `system_profile`: threads, plugin directories, emergency stop, other daemons.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::application::{Dependency, dependency};
use super::component::check_period;
use super::diagnostic::Reporter;
use super::plan::{ExecutorPlan, NodePlan, Policy, Schedule, SystemPlan};
use super::quantity;
use super::source::Word;
use super::xml::Element;
use crate::model::limits;

/// What to do when memory that all components share may be damaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OnTaint {
    /// Go on; the journal says so.
    #[default]
    Continue,
    /// Restart the daemon, warm, with checkpoints.
    Restart,
}

/// The system as written: names of slots and applications not yet resolved.
#[derive(Clone, Debug, Serialize)]
pub struct SystemProfile {
    /// What needs no resolving.
    #[serde(flatten)]
    pub plan: SystemPlan,
    /// Dependencies between applications.
    pub application_dependencies: Vec<Dependency>,
    /// Slots that get the emergency stop.
    pub actuators: Vec<Word>,
    /// True where `<emergency>` stands there, whatever it holds.
    #[serde(skip)]
    pub has_emergency: bool,
    /// True where an executor's name could not be read.
    #[serde(skip)]
    pub incomplete: bool,
}

/// Reads `<system_profile>` of the file at `path`.
pub fn read(root: &Element, path: &Path, report: &mut Reporter) -> SystemProfile {
    let plan = SystemPlan {
        name: root.text_of("name").to_owned(),
        plugin_dirs: plugin_dirs(root, path, report),
        executors: executors(root, report),
        nodes: nodes(root, report),
        dependencies: Vec::new(),
        emergency: Vec::new(),
        on_taint: on_taint(root),
    };
    let dependencies = root.children_of("dependency").map(|element| dependency(element, "application", report));
    let known = |child: &Element| child.name != "executor" || !child.value_of("name").is_empty();
    SystemProfile {
        plan,
        application_dependencies: dependencies.collect(),
        actuators: actuators(root, report),
        has_emergency: root.child("emergency").is_some() || root.misread,
        incomplete: root.misread || !root.children.iter().all(known),
    }
}

fn plugin_dirs(root: &Element, path: &Path, report: &mut Reporter) -> Vec<PathBuf> {
    let base = path.parent().unwrap_or(Path::new(""));
    let mut dirs = Vec::new();
    for element in root.children_of("plugins").filter(|element| !element.text.is_empty()) {
        let dir = base.join(&element.text);
        if !dir.is_dir() {
            report.warning(element.text_span, format!("plugin directory {} does not exist", dir.display())).hint =
                Some("it is relative to this file; build the plugins first, or correct it".to_owned());
        }
        dirs.push(dir);
    }
    dirs
}

fn executors(root: &Element, report: &mut Reporter) -> Vec<ExecutorPlan> {
    let mut names = BTreeSet::new();
    let mut all = Vec::new();
    for element in root.children_of("executor") {
        let name = report.value_word(element, "name");
        if all.len() == limits::EXECUTORS {
            report.error(element.name_span, format!("more than {} executors", limits::EXECUTORS));
            break;
        }
        if !name.text.is_empty() && !names.insert(name.text.clone()) {
            report.error(name.spot.span, format!("executor \"{}\" is already declared", name.text));
            continue;
        }
        all.push(executor(element, name.text, report));
    }
    all
}

fn executor(element: &Element, name: String, report: &mut Reporter) -> ExecutorPlan {
    let policy = match element.value_of("policy") {
        "fifo" => Policy::Fifo,
        "rr" => Policy::RoundRobin,
        _ => Policy::Other,
    };
    let priority = element.value_of("priority").parse().unwrap_or(0);
    let span = element.attribute("priority").map_or(element.name_span, |priority| priority.value_span);
    if policy != Policy::Other && priority < limits::PRIORITY_MIN {
        report.error(span, "a real-time policy needs a priority, 1 to 99");
    } else if policy == Policy::Other && priority > 0 {
        report.warning(span, "priority has no effect without policy=\"fifo\" or \"rr\"");
    }
    ExecutorPlan {
        name,
        period: element.attribute("period").map(|period| check_period(period.value_span, &period.value, report)),
        schedule: Schedule { policy, priority, cpus: quantity::cpus(element.value_of("cpu")).unwrap_or_default() },
        location: report.location(element.name_span),
    }
}

fn nodes(root: &Element, report: &mut Reporter) -> Vec<NodePlan> {
    let mut all: Vec<NodePlan> = Vec::new();
    for element in root.children_of("node") {
        report.not_active(element.name_span, "<node>");
        let name = report.value_word(element, "name");
        if all.iter().any(|other| other.name == name.text) {
            report.error(name.spot.span, format!("node \"{}\" is already declared", name.text));
        }
        let location = report.location(element.name_span);
        all.push(NodePlan { name: name.text, address: element.value_of("address").to_owned(), location });
    }
    all
}

fn on_taint(root: &Element) -> OnTaint {
    if root.value_of("on_taint") == "restart" { OnTaint::Restart } else { OnTaint::Continue }
}

fn actuators(root: &Element, report: &mut Reporter) -> Vec<Word> {
    if let Some(emergency) = root.child("emergency") {
        let count = emergency.children_of("actuator").count();
        if count > limits::ACTUATORS {
            report.error(emergency.name_span, format!("more than {} actuators", limits::ACTUATORS));
        }
        // What it holds instead is told already.
        if count == 0 && !emergency.misread {
            report.error(emergency.name_span, "<emergency> names no actuator").hint =
                Some("add <actuator component=\"motors\"/>".to_owned());
        }
    }
    let mut all: Vec<Word> = Vec::new();
    for element in root.grandchildren("emergency", "actuator") {
        let word = report.value_word(element, "component");
        if word.text.is_empty() {
            continue;
        }
        if let Some(first) = all.iter().find(|other| other.text == word.text) {
            let message = format!("\"{}\" is already an actuator in line {}", word.text, first.spot.location().line);
            report.error(word.spot.span, message).hint = Some("remove one of them: it gets the stop once".to_owned());
            continue;
        }
        all.push(word);
    }
    all
}
