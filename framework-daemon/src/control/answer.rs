//! Answers that are there at once: read from counters and from the directory of what runs.

use std::path::PathBuf;
use std::sync::Arc;

use serde_json::{Value, json};

use super::directory::{self, Board, Directory};
use super::interface::{INTERFACES, Method, PortName, Refusal};
use super::{composites, helpers, stream, views};
use crate::exec::emergency;
use crate::fault::manager::Outlook;
use crate::fault::order::Refused;
use crate::port::{registry, wiring};
use crate::sys::latch;

/// All that the control socket looks at.
pub(super) struct Sight {
    /// What runs.
    pub(super) board: Arc<Board>,
    /// What the fault manager knows.
    pub(super) outlook: Outlook,
    /// The profile directory.
    pub(super) profiles: PathBuf,
}

impl Sight {
    /// What runs now.
    ///
    /// # Errors
    /// When nothing does yet; `slot` is what was asked for.
    pub(super) fn directory(&self, slot: &str) -> Result<Arc<Directory>, Refusal> {
        let starting = || Refusal::NoSuchComponent(slot.to_owned(), "the daemon is starting: ask again".to_owned());
        self.board.newest().ok_or_else(starting)
    }

    /// The answer to a method; `None`: it comes later.
    ///
    /// # Errors
    /// When it is refused.
    pub(super) fn answer(&self, method: &Method) -> Result<Option<Value>, Refusal> {
        let answer = match method {
            Method::GetInfo => info(),
            Method::GetInterfaceDescription(name) => describe(name)?,
            Method::Status => self.status(),
            Method::ListComponents => json!({"components": self.components()}),
            Method::DescribeComponent(slot) => {
                let directory = self.directory(slot)?;
                let own = || Ok(views::component_details(&directory, stream::entry(&directory, slot)?, &self.outlook));
                json!({"component": composites::details(&directory, slot).map_or_else(own, Ok)?})
            }
            Method::ListPorts(None) => json!({"ports": self.all_ports()}),
            Method::ListPorts(Some(slot)) => {
                let directory = self.directory(slot)?;
                json!({"ports": ports_of(&directory, slot)?})
            }
            Method::DescribePort(name) => self.port(name)?,
            Method::ListFaults(slot, last) => {
                self.check_slot(slot.as_deref())?;
                json!({"faults": stream::list(self.outlook.feed(), slot.as_deref(), *last)})
            }
            Method::Follow(slot, _) => {
                self.check_slot(slot.as_deref())?;
                return Ok(None);
            }
            Method::Connect(..) | Method::Disconnect(_) if emergency::latched() => {
                return Err(Refusal::of_order(Refused::latched()));
            }
            Method::Connect(one, other) => wired(one, wiring::connect(registry::shared(), one.into(), other.into()))?,
            Method::Disconnect(name) => wired(name, wiring::disconnect(registry::shared(), name.into()))?,
            Method::Hz(..) | Method::Echo(_) | Method::Reload | Method::Order(..) => return Ok(None),
        };
        Ok(Some(answer))
    }

    /// Faults may be asked for of a slot that runs, or of one that is gone and left some.
    fn check_slot(&self, slot: Option<&str>) -> Result<(), Refusal> {
        let Some((slot, directory)) = slot.zip(self.board.newest()) else { return Ok(()) };
        let found = stream::entry(&directory, slot).map(|_| ());
        found.or_else(|refusal| if stream::knows(self.outlook.feed(), slot) { Ok(()) } else { Err(refusal) })
    }

    fn status(&self) -> Value {
        let directory = self.board.newest();
        let entries = directory.iter().flat_map(|directory| &directory.entries);
        let slots: Vec<Value> =
            entries.map(|entry| views::of_running(&entry.slot, &entry.shelf, &self.outlook)).collect();
        let helpers: Vec<Value> = directory.iter().flat_map(|directory| helpers::all(directory)).collect();
        json!({"state": self.board.phase().name(), "emergency": emergency::latched(), "latch": latch::view(), "directory": self.profiles.to_string_lossy(), "pid": std::process::id(),
            "slots": slots, "helpers": helpers, "process": views::of_process(self.outlook.ledger())})
    }

    fn components(&self) -> Vec<Value> {
        let Some(directory) = self.board.newest() else { return Vec::new() };
        let slots = directory.entries.iter().map(|entry| views::component(&directory, entry));
        slots.chain(composites::all(&directory)).collect()
    }

    fn all_ports(&self) -> Vec<Value> {
        let Some(directory) = self.board.newest() else { return Vec::new() };
        let wires = directory.wires();
        let own = directory.slots().flat_map(|slot| views::ports(slot, &wires));
        let voters = helpers::ports(&directory, &wires, None);
        own.chain(voters).chain(composites::all_ports(&directory, &wires)).collect()
    }

    fn port(&self, name: &PortName) -> Result<Value, Refusal> {
        let directory = self.directory(&name.slot)?;
        let shown = composites::ports_of(&directory, &name.slot);
        let shown = shown.and_then(|ports| ports.into_iter().find(|port| port["port"] == *name.port));
        let name = &*composites::inner(&directory, name);
        if let Some(output) = directory.output(&name.slot, &name.port).filter(|_| directory.entry(&name.slot).is_none())
        {
            let port = helpers::ports(&directory, &directory.wires(), Some(&name.slot)).into_iter().next();
            return Ok(json!({"port": shown.or(port), "layout": views::layout(output.object)}));
        }
        let slot = stream::slot(&directory, &name.slot)?;
        let found = views::ports(slot, &directory.wires()).into_iter().find(|port| port["port"] == *name.port);
        let missing = || Refusal::NoSuchPort(name.clone(), directory::missing_port(slot, &name.port));
        let (port, layout) = found.zip(views::port_layout(slot, &name.port)).ok_or_else(missing)?;
        Ok(json!({"port": shown.unwrap_or(port), "layout": layout}))
    }
}

/// The ports of a slot, a voter or a composite.
fn ports_of(directory: &Directory, slot: &str) -> Result<Vec<Value>, Refusal> {
    let shown = composites::ports_of(directory, slot);
    let wires = directory.wires();
    let voter = || Some(helpers::ports(directory, &wires, Some(slot))).filter(|ports| !ports.is_empty());
    let own = || Ok(views::ports(stream::slot(directory, slot)?, &wires));
    shown.or_else(voter).map_or_else(own, Ok)
}

/// An operator wires ports as a component does: on the spot, and nobody waits.
fn wired(name: &PortName, result: Result<(), wiring::Refusal>) -> Result<Value, Refusal> {
    result.map_err(|refusal| Refusal::WiringRefused(name.clone(), refusal.code(), refusal.to_string()))?;
    tracing::info!("wired by an operator: {}.{}", name.slot, name.port);
    Ok(json!({}))
}

impl<'a> From<&'a PortName> for wiring::Name<'a> {
    fn from(name: &'a PortName) -> Self {
        Self { slot: &name.slot, port: &name.port }
    }
}

fn info() -> Value {
    json!({"vendor": "framework-daemon", "product": "framework-daemon", "version": env!("CARGO_PKG_VERSION"),
        "url": "https://varlink.org/Service", "interfaces": INTERFACES.map(|(name, _)| name)})
}

fn describe(name: &str) -> Result<Value, Refusal> {
    let found = INTERFACES.iter().find(|(known, _)| *known == name);
    let (_, description) = found.ok_or_else(|| Refusal::InterfaceNotFound(name.to_owned()))?;
    Ok(json!({"description": description}))
}
