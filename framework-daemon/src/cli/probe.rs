//! `probe`, hidden: loads a plugin and ends. The daemon starts it for every plugin file that it never loaded.

use std::path::PathBuf;

use clap::Args;

use super::exit_code::Exit;
use crate::plugin::Plugin;
use crate::port::border::HOST;

/// Arguments of `probe`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Plugin.
    #[arg(value_name = "PLUGIN.so")]
    pub plugin: PathBuf,
}

/// Loads it.
#[must_use]
pub fn run(arguments: &Arguments) -> Exit {
    Plugin::load(&arguments.plugin, &HOST).map_or(Exit::PluginRefused, |_| Exit::Done)
}
