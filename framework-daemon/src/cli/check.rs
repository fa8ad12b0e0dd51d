//! `check`: everything that can be wrong, without running anything.
//!
//! A directory is checked as a whole, as `run` would load it. A file is checked alone: names inside it are resolved, but
//! files that it refers to are not looked for, because a component's profile is often checked where it is written, far
//! from the application that uses it. The first draft followed references from single files too, and every file of a
//! component library was refused for want of its neighbours.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::Format;
use super::exit_code::Exit;
use crate::profile::diagnostic::{Diagnostic, Level};
use crate::profile::document::{Document, Profile};
use crate::profile::load;
use crate::profile::single;
use crate::supervise::catalogue::Catalogue;
use crate::supervise::{blueprint, boot, monitors, wiring};

const EXAMPLES: &str = "Examples:\n  framework-daemon check profiles/navigation\n  \
     framework-daemon check --format json Camera.xml Planner.xml\n  \
     framework-daemon check profiles/navigation --plugins target/release\n\n\
     Exit codes: 0 accepted (warnings and notes possible), 3 something is wrong, 4 a plugin does not fit.";

/// Arguments of `check`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Profile directories, checked as a whole, or single profile files.
    #[arg(required = true, value_name = "DIR|FILE")]
    pub paths: Vec<PathBuf>,
    /// How findings are printed; json: one object a file.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
    /// Also hold directories against their plugins, looked for here and where the profiles say; may be repeated.
    #[arg(long, value_name = "DIR")]
    pub plugins: Vec<PathBuf>,
}

/// What is said about one file.
struct Verdict {
    file: PathBuf,
    root: String,
    profile: Option<Profile>,
    findings: Vec<Diagnostic>,
}

/// Checks every path.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    let mut totals = [0_usize; 3];
    let mut files = 0;
    let mut refused = false;
    for path in &arguments.paths {
        refused |= !arguments.plugins.is_empty() && !check_plugins(path, &arguments.plugins)?;
        let verdicts = if path.is_dir() { check_directory(path) } else { vec![check_file(path)] };
        files += verdicts.len();
        for verdict in &verdicts {
            for finding in &verdict.findings {
                totals[finding.level as usize] += 1;
            }
            print(verdict, arguments.format, out)?;
        }
    }
    let [errors, warnings, notes] = totals;
    if arguments.format == Format::Text {
        let parts = [(files, "file"), (errors, "error"), (warnings, "warning"), (notes, "note")].map(counted);
        let [files, errors, warnings, notes] = parts;
        writeln!(out, "{files} checked: {errors}, {warnings}, {notes}")?;
    }
    Ok(match (errors, refused) {
        (0, false) => Exit::Done,
        (0, true) => Exit::PluginRefused,
        _ => Exit::ProfileInvalid,
    })
}

/// Loads the plugins of a valid directory and compares ports, properties and layouts; false: something is wrong, which is
/// told on stderr. Nothing is run but the libraries' own constructors.
fn check_plugins(path: &Path, plugins: &[PathBuf]) -> io::Result<bool> {
    let Some(plan) = path.is_dir().then(|| load::load(path).ok()).flatten().map(|loaded| loaded.plan) else {
        return Ok(true);
    };
    let catalogue = Catalogue::default().in_directories(boot::directories(&plan, plugins));
    let wrong = match blueprint::draw(&plan.slots, &catalogue) {
        Ok(blueprints) => {
            let mut wrong = wiring::check(&plan, &blueprints);
            wrong.extend(monitors::check(&plan, &blueprints));
            wrong
        }
        Err(reasons) => reasons,
    };
    let found = catalogue.warnings();
    found.iter().chain(&wrong).try_for_each(|reason| writeln!(io::stderr(), "{reason}"))?;
    Ok(wrong.is_empty())
}

fn counted((count, what): (usize, &str)) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn check_file(path: &Path) -> Verdict {
    let document = single::check(path);
    let Document { path, root, profile, findings } = document;
    Verdict { file: path.to_path_buf(), root, profile, findings }
}

/// One verdict a file; what is wrong with the directory itself comes first.
fn check_directory(dir: &Path) -> Vec<Verdict> {
    let survey = load::survey(dir);
    let mut verdicts: Vec<Verdict> = Vec::new();
    for finding in survey.diagnostics {
        let file = finding.location.file.to_path_buf();
        match verdicts.iter_mut().find(|verdict| verdict.file == file) {
            Some(verdict) => verdict.findings.push(finding),
            None => verdicts.push(Verdict { file, root: String::new(), profile: None, findings: vec![finding] }),
        }
    }
    for document in survey.documents {
        let (root, profile) = (document.root.clone(), document.profile.clone());
        match verdicts.iter_mut().find(|verdict| verdict.file == **document.path) {
            Some(verdict) => (verdict.root, verdict.profile) = (root, profile),
            None => verdicts.push(Verdict { file: document.path.to_path_buf(), root, profile, findings: Vec::new() }),
        }
    }
    verdicts
}

fn print(verdict: &Verdict, format: Format, out: &mut impl Write) -> io::Result<()> {
    if format == Format::Text {
        for finding in &verdict.findings {
            writeln!(out, "{finding}")?;
        }
        return Ok(());
    }
    let accepted = !verdict.findings.iter().any(|finding| finding.level == Level::Error);
    let object = json!({
        "file": verdict.file.to_string_lossy(),
        "root": verdict.root,
        "accepted": accepted,
        "diagnostics": verdict.findings,
        "profile": verdict.profile,
    });
    writeln!(out, "{object}")
}
