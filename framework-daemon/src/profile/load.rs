//! A directory to a plan: which files count, in which order they are read, and the verdict.
//!
//! Every XML file at the top of the directory counts, also one that nothing refers to: what lies there is right or is
//! reported. A file whose root is no profile's at all is passed over with a warning, because directories hold other XML
//! too, unless its root looks like a misspelt one.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::assemble::Assembler;
use super::diagnostic::{self, Diagnostic, Level};
use super::document::{Document, Profile};
use super::files::Files;
use super::plan::{Plan, SystemPlan};
use super::suggest;
use super::validate;
use super::vocabulary::ROOTS;
use crate::model::limits;

/// A plan, and what is worth knowing about it.
#[derive(Debug)]
pub struct Loaded {
    /// The plan.
    pub plan: Plan,
    /// Warnings and notes.
    pub diagnostics: Vec<Diagnostic>,
}

/// Everything that was found in a directory, accepted or not.
#[derive(Debug)]
pub struct Survey {
    /// Every file that was read.
    pub documents: Vec<Arc<Document>>,
    /// Every finding, in the order of files and lines.
    pub diagnostics: Vec<Diagnostic>,
    /// The plan, if nothing is wrong.
    pub plan: Option<Plan>,
}

/// Loads a profile directory.
///
/// # Errors
/// Every finding of every file, if one of them is an error.
pub fn load(dir: &Path) -> Result<Loaded, Vec<Diagnostic>> {
    let Survey { diagnostics, plan, .. } = survey(dir);
    match plan {
        Some(plan) => Ok(Loaded { plan, diagnostics }),
        None => Err(diagnostics),
    }
}

/// Reads a profile directory and everything that its files refer to.
#[must_use]
pub fn survey(dir: &Path) -> Survey {
    let mut files = Files::default();
    let mut findings = Vec::new();
    let mut top = Vec::new();
    match list(dir) {
        Ok(paths) => top.extend(paths.iter().filter_map(|path| files.open(path)).map(|(_, document)| document)),
        Err(finding) => findings.push(finding),
    }
    let system = the_system(&top, &mut findings);
    let all_read = top.iter().all(|document| document.profile.is_some() || is_stranger(document));
    // A file that could not be read may well be the system that declares them.
    let mut assembler = Assembler::default();
    assembler.executors_unknown = system.is_none() && !all_read;
    if let Some(Profile::System(profile)) = system.as_ref().and_then(|document| document.profile.as_ref()) {
        assembler.executors.clone_from(&profile.plan.executors);
        assembler.executors_unknown = profile.incomplete;
    }
    let applications = the_applications(dir, &top, all_read, &mut findings);
    for document in &applications {
        assembler.application(&mut files, document);
    }
    let used = std::mem::take(&mut assembler.used);
    let plan = validate::finish(dir, system.as_deref(), (&applications, all_read), assembler, &mut findings);
    let diagnostics = verdict(&files, &used, findings);
    let accepted = !diagnostics.iter().any(Diagnostic::is_error);
    Survey { documents: files.documents().to_vec(), diagnostics, plan: accepted.then_some(plan) }
}

/// The XML files at the top of `dir`, by name.
fn list(dir: &Path) -> Result<Vec<PathBuf>, Diagnostic> {
    let error = |message: String| Diagnostic::of_file(Level::Error, dir, message);
    let entries = std::fs::read_dir(dir).map_err(|cause| {
        error(format!("cannot be read: {cause}")).with_hint("name a directory that holds an application_profile")
    })?;
    let mut paths = Vec::new();
    for entry in entries {
        let path = entry.map_err(|cause| error(format!("cannot be read: {cause}")))?.path();
        let is_xml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml"));
        // An editor's hidden files and a directory called x.xml are no profiles.
        let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if is_xml && !is_hidden && !path.is_dir() {
            paths.push(path);
        }
        if paths.len() > limits::PROFILE_FILES {
            return Err(error(format!("holds more than {} XML files", limits::PROFILE_FILES)));
        }
    }
    paths.sort();
    Ok(paths)
}

fn the_system(top: &[Arc<Document>], findings: &mut Vec<Diagnostic>) -> Option<Arc<Document>> {
    let mut systems = top.iter().filter(|document| matches!(document.profile, Some(Profile::System(_))));
    let first = systems.next()?;
    for other in systems {
        let message = format!("a second system_profile; the first is {}", first.path.display());
        findings.push(
            Diagnostic::of_file(Level::Error, &other.path, message)
                .with_hint("a directory holds at most one: merge them, or move one away"),
        );
    }
    Some(Arc::clone(first))
}

fn the_applications(
    dir: &Path,
    top: &[Arc<Document>],
    all_read: bool,
    findings: &mut Vec<Diagnostic>,
) -> Vec<Arc<Document>> {
    let is_application = |document: &&Arc<Document>| matches!(document.profile, Some(Profile::Application(_)));
    let applications: Vec<Arc<Document>> = top.iter().filter(is_application).cloned().collect();
    // A file that could not be read may well be the application that is missed.
    if applications.is_empty() && all_read && findings.is_empty() {
        findings.push(Diagnostic::of_file(Level::Error, dir, "holds no application_profile").with_hint(
            "a profile directory holds one or more application_profile files and at most one system_profile",
        ));
    }
    applications
}

/// All findings together, in the order in which the files were read.
fn verdict(files: &Files, used: &HashSet<PathBuf>, mut findings: Vec<Diagnostic>) -> Vec<Diagnostic> {
    for document in files.documents() {
        findings.extend(document.findings.iter().map(|finding| excuse_strangers(document, finding)));
    }
    // Of a component that a slot uses, the slot's executor has been asked for a period.
    let unused = files.documents().iter().filter(|document| !used.contains(&**document.path));
    findings.extend(unused.filter_map(|document| document.missing_period().cloned()));
    let rank = |path: &Path| files.documents().iter().position(|document| **document.path == *path);
    diagnostic::tidy(&mut findings, |path| rank(path).map_or(0, |rank| rank + 1));
    findings
}

/// A root that is not near any profile's root is some other XML file.
fn excuse_strangers(document: &Document, finding: &Diagnostic) -> Diagnostic {
    let mut finding = finding.clone();
    if is_stranger(document) && finding.is_error() {
        finding.level = Level::Warning;
        finding.hint = Some("the file is passed over".to_owned());
    }
    finding
}

fn is_stranger(document: &Document) -> bool {
    let names: Vec<&str> = ROOTS.iter().map(|rule| rule.name).collect();
    !document.root.is_empty() && document.profile.is_none() && suggest::nearest(&document.root, names).is_none()
}

/// The system's part of the plan, or its defaults.
#[must_use]
pub fn system_plan(system: Option<&Document>) -> SystemPlan {
    match system.and_then(|document| document.profile.as_ref()) {
        Some(Profile::System(profile)) => profile.plan.clone(),
        _ => SystemPlan::default(),
    }
}
