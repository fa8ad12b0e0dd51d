//! `graph`: slots as boxes, ports on their sides, connections between them.

use std::io::{self, Write};
use std::path::PathBuf;

use clap::{Args, ValueEnum};

/// For Graphviz.
pub mod dot;
/// What the framework inserts.
pub mod inserted;
/// Where everything is drawn.
pub mod layout;
mod manager;
/// For Markdown.
pub mod mermaid;
/// A picture of its own.
pub mod svg;

use super::exit_code::Exit;
use crate::profile;
use crate::profile::plan::{DependencyPlan, Limit, MonitorPlan, Plan, Validity};

const EXAMPLES: &str = "Examples:\n  framework-daemon graph profiles/navigation --as svg > navigation.svg\n  \
     framework-daemon graph profiles/navigation --as dot | dot -Tpdf > navigation.pdf\n\n\
     Drawn are slots with their ports, connections, who needs whom, and what the framework inserts: voters, comparisons with \
     models, monitors. The directory must be accepted by `check`.\n\n\
     Exit codes: 0 drawn, 3 a profile is invalid.";

/// Arguments of `graph`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Profile directory.
    pub dir: PathBuf,
    /// What to write.
    #[arg(long = "as", value_enum, default_value_t)]
    pub output: Output,
}

/// Ways to draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Output {
    /// For Graphviz.
    #[default]
    Dot,
    /// For Markdown.
    Mermaid,
    /// A picture, laid out here.
    Svg,
}

/// What a `<validity>` asks, as people write it: `range 0.03..3`, `speed 2/s`.
fn range(validity: &Validity) -> String {
    let bound = |limit: &Option<Limit>| match limit {
        Some(Limit::Constant(value)) => value.to_string(),
        Some(Limit::Linear { of, .. }) => format!("f({of})"),
        None => String::new(),
    };
    let mut text = validity.field.clone();
    if validity.min.is_some() || validity.max.is_some() {
        text.push_str(&format!(" {}..{}", bound(&validity.min), bound(&validity.max)));
    }
    text.extend(validity.max_rate.map(|rate| format!(" {rate}/s")));
    text.trim().to_owned()
}

/// What a monitor watches.
fn monitored(monitor: &MonitorPlan) -> String {
    let age = monitor.max_age.map(|age| format!("not silent for {age:?}"));
    monitor.validity.iter().map(range).chain(age).collect::<Vec<_>>().join(", ")
}

/// What a dependency asks: `needs 1 of 3`.
fn needed(dependency: &DependencyPlan) -> String {
    match dependency.on.len() {
        1 => "needs".to_owned(),
        count => format!("needs {} of {count}", dependency.require),
    }
}

/// What the picture shows, counted: the slots and connections of the profiles, and what the framework inserts.
fn heading(plan: &Plan) -> String {
    let plural = |count: usize, what: &str| format!("{count} {what}{}", if count == 1 { "" } else { "s" });
    let helpers =
        [(plan.votings.len(), "voter"), (plan.reference_models.len(), "comparison"), (plan.monitors.len(), "monitor")];
    let mut parts = vec![plural(plan.slots.len(), "slot"), plural(plan.connections.len(), "connection")];
    parts.extend(helpers.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| plural(count, what)));
    format!("{}: {}", plan.applications.join(", "), parts.join(", "))
}

/// Draws a directory that is accepted.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    let (plan, heading) = match profile::load(&arguments.dir) {
        Ok(loaded) => {
            // Before the boxes of what the framework inserts are among the slots.
            let heading = heading(&loaded.plan);
            (inserted::with_helpers(manager::shown(loaded.plan)), heading)
        }
        Err(diagnostics) => {
            for finding in diagnostics.iter().filter(|finding| finding.is_error()) {
                writeln!(io::stderr(), "{finding}")?;
            }
            return Ok(Exit::ProfileInvalid);
        }
    };
    let text = match arguments.output {
        Output::Dot => dot::draw(&plan),
        Output::Mermaid => mermaid::draw(&plan),
        Output::Svg => svg::draw(&plan, &heading),
    };
    out.write_all(text.as_bytes())?;
    Ok(Exit::Done)
}
