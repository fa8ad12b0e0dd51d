//! The command line: one file per verb, exit codes in one enum.
//!
//! Help, manual page and completions come from the one definition below.

use std::io::{self, Write};

use clap::{Parser, Subcommand, ValueEnum};

/// `check`.
pub mod check;
/// `completions`.
pub mod completions;
/// `component`.
pub mod component;
/// `connect` and `disconnect`.
pub mod connect;
/// `describe`.
pub mod describe;
/// Exit codes.
pub mod exit_code;
/// `fault`.
pub mod fault;
/// `fault show`.
mod fault_show;
/// `graph`.
pub mod graph;
/// `man`.
pub mod man;
/// `port`.
pub mod port;
/// `probe`.
pub mod probe;
/// `reload`.
pub mod reload;
/// What asks a running daemon.
mod remote;
/// `run`.
pub mod run;
/// `schema`.
pub mod schema;
/// `status`.
pub mod status;

pub use exit_code::Exit;

const EXIT_CODES: &str = "Examples:\n  framework-daemon check profiles/navigation\n  \
     framework-daemon run profiles/navigation --plugins target/release\n  \
     framework-daemon status\n\n\
     `framework-daemon help VERB` tells more, with examples.\n\n\
     Exit codes: 0 done, 1 failed, 2 wrong usage, 3 profile invalid, 4 plugin refused, \
     5 daemon not reachable, 6 refused by the daemon, 7 emergency latched.";

/// Runs a robot's components from XML profiles and keeps it working when they fail.
#[derive(Debug, Parser)]
#[command(name = "framework-daemon", version, after_help = EXIT_CODES, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Run a profile directory until SIGTERM or SIGINT.
    Run(run::Arguments),
    /// Find everything that is wrong with profiles, without running anything.
    Check(check::Arguments),
    /// Print the component profiles that a plugin's own metadata gives.
    Describe(describe::Arguments),
    /// Draw the slots of a profile directory, what connects them, and what watches them.
    Graph(graph::Arguments),
    /// Print the XSD of a kind of profile.
    Schema(schema::Arguments),
    /// Tell how all slots of a running daemon are.
    Status(status::Arguments),
    /// Show the components of a running daemon; start, stop and reset them.
    Component(component::Arguments),
    /// Show the ports of a running daemon, the values that pass them and their rates.
    Port(port::Arguments),
    /// Connect two ports of a running daemon.
    Connect(connect::Connect),
    /// Cut the connections of a port of a running daemon.
    Disconnect(connect::Disconnect),
    /// Show what failed in a running daemon, and what was done about it; take back the emergency stop.
    Fault(fault::Arguments),
    /// Have a running daemon read its profiles again, all or nothing.
    Reload(reload::Arguments),
    /// Print completions for a shell.
    Completions(completions::Arguments),
    /// Print the manual page.
    #[command(after_help = man::EXAMPLES)]
    Man,
    /// Load a plugin and end.
    #[command(hide = true)]
    Probe(probe::Arguments),
}

/// How results are printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Format {
    /// For people.
    #[default]
    Text,
    /// For programs: one object a line.
    Json,
}

/// Parses the arguments, runs the verb and returns its exit code.
pub fn main() -> Exit {
    let cli = Cli::parse();
    let mut out = io::stdout().lock();
    let result = match cli.verb {
        Verb::Run(arguments) => run::run(arguments, &mut out),
        Verb::Describe(arguments) => describe::run(&arguments, &mut out),
        Verb::Check(arguments) => check::run(&arguments, &mut out),
        Verb::Graph(arguments) => graph::run(&arguments, &mut out),
        Verb::Schema(arguments) => schema::run(&arguments, &mut out),
        Verb::Status(arguments) => status::run(&arguments, &mut out),
        Verb::Component(arguments) => component::run(&arguments, &mut out),
        Verb::Port(arguments) => port::run(&arguments, &mut out),
        Verb::Connect(arguments) => connect::connect(&arguments, &mut out),
        Verb::Disconnect(arguments) => connect::disconnect(&arguments, &mut out),
        Verb::Fault(arguments) => fault::run(&arguments, &mut out),
        Verb::Reload(arguments) => reload::run(&arguments, &mut out),
        Verb::Completions(arguments) => completions::run(&arguments, &mut out),
        Verb::Man => man::run(&mut out),
        Verb::Probe(arguments) => Ok(probe::run(&arguments)),
    };
    let flushed = out.flush();
    exit_of(result.and_then(|exit| match flushed {
        // A reader that has seen enough changes nothing about what was found.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error),
        _ => Ok(exit),
    }))
}

/// A reader that has seen enough (`| head`) is no failure.
fn exit_of(result: io::Result<Exit>) -> Exit {
    match result {
        Ok(exit) => exit,
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Exit::Done,
        Err(error) => {
            let _ = writeln!(io::stderr(), "framework-daemon: cannot write the result: {error}");
            Exit::Failed
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::Cli;

    #[test]
    fn the_definition_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn every_verb_shows_an_example() {
        fn look(command: &clap::Command) {
            for verb in command.get_subcommands().filter(|verb| !verb.is_hide_set()) {
                let help = verb.get_after_help().map(ToString::to_string).unwrap_or_default();
                assert!(help.contains("Examples:"), "{} has no example", verb.get_name());
                look(verb);
            }
        }
        look(&Cli::command());
    }

    /// A text that goes on in the next line of the source must not bring its indentation along.
    #[test]
    fn no_help_has_a_gap_in_a_line() {
        fn look(command: &clap::Command) {
            let help = command.clone().render_long_help().to_string();
            let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let gap = |line: &&str| line.strip_prefix("  ").unwrap_or(line).contains("  ");
            assert_eq!(after.lines().find(gap), None, "{}", command.get_name());
            assert!(help.contains(after.lines().next().unwrap_or_default()), "{help}");
            command.get_subcommands().filter(|verb| !verb.is_hide_set()).for_each(look);
        }
        look(&Cli::command());
    }
}
