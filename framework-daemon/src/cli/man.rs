//! `man`: the manual page, from the definition of the command line itself.

use std::io::{self, Write};

use clap::CommandFactory;

use super::Cli;
use super::exit_code::Exit;

pub(super) const EXAMPLES: &str = "Examples:\n  framework-daemon man | man -l -\n  \
     framework-daemon man > /usr/local/share/man/man1/framework-daemon.1";

/// Prints the manual page: the program, then each verb.
///
/// # Errors
/// Only those of writing.
pub fn run(out: &mut impl Write) -> io::Result<Exit> {
    let command = Cli::command();
    clap_mangen::Man::new(command.clone()).render(out)?;
    describe(&command, "framework-daemon", out)?;
    Ok(Exit::Done)
}

/// The verbs of a command, and theirs.
fn describe(command: &clap::Command, name: &str, out: &mut impl Write) -> io::Result<()> {
    for verb in command.get_subcommands().filter(|verb| !verb.is_hide_set()) {
        let name = format!("{name} {}", verb.get_name());
        let page = clap_mangen::Man::new(verb.clone().bin_name(&name));
        writeln!(out, ".SH {}", name.to_uppercase())?;
        page.render_description_section(out)?;
        page.render_synopsis_section(out)?;
        page.render_options_section(out)?;
        page.render_extra_section(out)?;
        describe(verb, &name, out)?;
    }
    Ok(())
}
