//! `schema`: the XSD of a kind of profile, for editors that complete and check while one types.

use std::io::{self, Write};

use clap::{Args, ValueEnum};

use super::exit_code::Exit;

const EXAMPLES: &str = "Examples:\n  framework-daemon schema application > application.xsd\n  \
     framework-daemon schema component | xmllint --noout --schema /dev/stdin Camera.xml";

/// Arguments of `schema`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Kind of profile.
    pub kind: Kind,
}

/// Kinds of profiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Kind {
    /// `system_profile`.
    System,
    /// `application_profile` and `package_profile`.
    Application,
    /// `component_profile`.
    Component,
    /// `composite_component_profile`.
    Composite,
    /// `data_type`.
    DataType,
    /// `service_port_type_profile`.
    Service,
}

/// Prints the schema.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: &Arguments, out: &mut impl Write) -> io::Result<Exit> {
    let text = match arguments.kind {
        Kind::System => include_str!("../../../profiles/schema/system.xsd"),
        Kind::Application => include_str!("../../../profiles/schema/application.xsd"),
        Kind::Component => include_str!("../../../profiles/schema/component.xsd"),
        Kind::Composite => include_str!("../../../profiles/schema/composite.xsd"),
        Kind::DataType => include_str!("../../../profiles/schema/data_type.xsd"),
        Kind::Service => include_str!("../../../profiles/schema/service.xsd"),
    };
    out.write_all(text.as_bytes())?;
    Ok(Exit::Done)
}
