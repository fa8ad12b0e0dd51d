//! `completions`: for bash, zsh, fish and others, from the definition of the command line itself.

use std::io::{self, Write};

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::Cli;
use super::exit_code::Exit;

const EXAMPLES: &str = "Examples:\n  framework-daemon completions bash > /etc/bash_completion.d/framework-daemon\n  \
     framework-daemon completions fish > ~/.config/fish/completions/framework-daemon.fish";

/// Arguments of `completions`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The shell.
    pub shell: Shell,
}

/// Prints the completions.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    // clap_complete panics where it cannot write, so it writes to memory first.
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, &mut Cli::command(), "framework-daemon", &mut text);
    out.write_all(&text)?;
    Ok(Exit::Done)
}
