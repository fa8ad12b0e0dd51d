//! The wiring pattern: any component connects and disconnects ports of any other, by name, while everything runs. A skill
//! that changes who drives the motors is such a component.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Lets the second avoider drive.
//! #[derive(Component)]
//! #[component(name = "Switch", periodic = "1s")]
//! pub struct Switch {}
//!
//! impl Callbacks for Switch {
//!     fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
//!         cx.wiring().connect(("motors", "command"), ("avoider_b", "command"))?;
//!         Ok(())
//!     }
//! }
//! ```

use std::fmt;

use crate::abi::host::HostApi;
use crate::abi::links::{PortName, Reason};
use crate::status::Status;

/// Connects and disconnects ports; from [`Context::wiring`](crate::context::Context::wiring). Nothing waits, and nothing
/// that runs over other connections is disturbed.
pub struct Wiring<'a> {
    host: &'a HostApi,
}

impl<'a> Wiring<'a> {
    pub(crate) const fn new(host: &'a HostApi) -> Self {
        Self { host }
    }

    /// Connects two ports, each named by slot and port, in either order. What the reader, or the client, was connected to
    /// before is disconnected first, and stays so where the two do not fit.
    ///
    /// # Errors
    /// `UnknownComponent`, `UnknownPort`: the first is not there; `ServiceUnavailable`: the second is not;
    /// `IncompatibleService`: pattern or objects differ; `Error`: others wire the same port all the time.
    pub fn connect(&self, one: (&str, &str), other: (&str, &str)) -> Result<(), Refusal> {
        let mut reason = Reason::NONE;
        Refusal::of((self.host.links.connect)(name(one), name(other), &mut reason), &reason)
    }

    /// Cuts all connections of a port that reads, writes or asks. One that has none is no mistake.
    ///
    /// # Errors
    /// `UnknownComponent`, `UnknownPort`; `IncompatibleService`: the port is a server, whose clients are to be
    /// disconnected; `Error`: others wire it all the time.
    pub fn disconnect(&self, port: (&str, &str)) -> Result<(), Refusal> {
        let mut reason = Reason::NONE;
        Refusal::of((self.host.links.disconnect)(name(port), &mut reason), &reason)
    }
}

fn name<'a>((slot, port): (&'a str, &'a str)) -> PortName<'a> {
    PortName { slot: slot.into(), port: port.into() }
}

/// Why ports are not connected, or not disconnected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// What kind of reason.
    pub status: Status,
    /// The reason, in words that name both sides.
    pub reason: String,
}

impl Refusal {
    pub(crate) fn of(code: u32, reason: &Reason) -> Result<(), Self> {
        if code == 0 {
            return Ok(());
        }
        let (status, bytes) = (Status::from_code(code), reason.bytes.get(..reason.len).unwrap_or_default());
        let reason = if bytes.is_empty() { status.to_string() } else { String::from_utf8_lossy(bytes).into_owned() };
        Err(Self { status, reason })
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.reason)
    }
}

impl std::error::Error for Refusal {}
