//! `connect` and `disconnect`: an operator wires the ports of a running daemon.

use std::io::{self, Write};

use clap::Args;
use serde_json::{Map, Value};

use super::exit_code::Exit;
use super::remote::{Remote, parameters, port_name};

const CONNECT_EXAMPLES: &str = "Examples:\n  framework-daemon connect motors.command avoider_b.command\n\n\
     The order does not matter. What the reader, or the client, was connected to before is disconnected first, and stays so \
     where the two do not fit. The profiles are not changed: a restart connects as they say.\n\n\
     Exit codes: 0 connected, 5 no daemon can be reached, 6 refused: no such port, or the two do not fit.";

const DISCONNECT_EXAMPLES: &str = "Examples:\n  framework-daemon disconnect motors.command\n\n\
     What a voter or a model hears it hears all the same.\n\n\
     Exit codes: 0 disconnected, 5 no daemon can be reached, 6 refused: no such port, or it has no connection.";

/// Arguments of `connect`.
#[derive(Debug, Args)]
#[command(after_help = CONNECT_EXAMPLES)]
pub struct Connect {
    /// One port.
    #[arg(value_name = "SLOT.PORT", value_parser = port_name)]
    pub one: (String, String),
    /// The other one.
    #[arg(value_name = "SLOT.PORT", value_parser = port_name)]
    pub other: (String, String),
    /// Which daemon, and how it is printed.
    #[command(flatten)]
    pub remote: Remote,
}

/// Arguments of `disconnect`.
#[derive(Debug, Args)]
#[command(after_help = DISCONNECT_EXAMPLES)]
pub struct Disconnect {
    /// The port.
    #[arg(value_name = "SLOT.PORT", value_parser = port_name)]
    pub port: (String, String),
    /// Which daemon, and how it is printed.
    #[command(flatten)]
    pub remote: Remote,
}

/// Asks.
///
/// # Errors
/// Only those of writing.
pub fn connect(arguments: &Connect, out: &mut impl Write) -> io::Result<Exit> {
    let ((slot, port), (to_slot, to_port)) = (&arguments.one, &arguments.other);
    let asked = named([("slot", slot), ("port", port), ("to_slot", to_slot), ("to_port", to_port)]);
    arguments.remote.ask("Connect", asked, out, |_| vec![format!("connected {slot}.{port} and {to_slot}.{to_port}")])
}

/// Asks.
///
/// # Errors
/// Only those of writing.
pub fn disconnect(arguments: &Disconnect, out: &mut impl Write) -> io::Result<Exit> {
    let (slot, port) = &arguments.port;
    let asked = named([("slot", slot), ("port", port)]);
    arguments.remote.ask("Disconnect", asked, out, |_| vec![format!("disconnected {slot}.{port}")])
}

fn named<const N: usize>(fields: [(&str, &String); N]) -> Map<String, Value> {
    parameters(fields.map(|(name, value)| (name, Some(value.as_str().into()))))
}
