//! `graph`.
use super::exit_code::Exit;
use clap::Args;
use std::io::{self, Write};
/// Arguments of `graph`.
#[derive(Debug, Args)]
#[command(after_help = "Examples:")]
pub struct Arguments {}
/// Draws.
///
/// # Errors
/// Only those of writing.
pub fn run(_: &Arguments, _: &mut impl Write) -> io::Result<Exit> {
    Ok(Exit::Done)
}
