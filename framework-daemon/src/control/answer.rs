//! Answers that are there at once: read from counters and from the directory of what runs.

use std::path::PathBuf;
use std::sync::Arc;

use serde_json::{Value, json};

use super::directory::{self, Besides, Board, Directory};
use super::interface::{INTERFACES, Method, PortName, Refusal};
use super::{composites, helpers, stream, views};
use crate::exec::emergency;
use crate::fault::manager::Outlook;
use crate::fault::order::{Refused, Verb};
use crate::fault::ports;
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
        self.board.newest().ok_or_else(|| Refusal::NoSuchComponent(slot.to_owned(), STARTING.to_owned()))
    }

    /// What may be changed, an operator may change when all runs: what a start is at is not for others to undo, and whether the
    /// emergency stop was left latched is not known before. Orders are for slots.
    ///
    /// # Errors
    /// When it is too early, or there is no such slot.
    pub(super) fn admit(&self, method: &Method) -> Result<(), Refusal> {
        let is_change = matches!(method, Method::Order(..) | Method::Connect(..) | Method::Disconnect(_));
        let starting = || Refusal::OrderRefused(STARTING.to_owned());
        let Some(directory) = is_change.then(|| self.board.newest().ok_or_else(starting)).transpose()? else {
            return Ok(());
        };
        match method {
            Method::Order(verb, slot) if *verb != Verb::Clear => {
                stream::entry(&directory, slot, Besides::Nothing).map(|_| ())
            }
            _ => Ok(()),
        }
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
                let own = || {
                    let entry = stream::entry(&directory, slot, Besides::All)?;
                    Ok(views::component_details(&directory, entry, &self.outlook))
                };
                let inserted = || helpers::details(&directory, slot);
                json!({"component": composites::details(&directory, slot).or_else(inserted).map_or_else(own, Ok)?})
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
            Method::Disconnect(name) => self.cut(name)?,
            Method::Hz(..) | Method::Echo(_) | Method::Reload | Method::Order(..) => return Ok(None),
        };
        Ok(Some(answer))
    }

    /// Faults may be asked for of a slot that runs, or of one that is gone and left some.
    fn check_slot(&self, slot: Option<&str>) -> Result<(), Refusal> {
        let Some((slot, directory)) = slot.zip(self.board.newest()) else { return Ok(()) };
        if directory.helpers.named().any(|(name, _)| name == slot) || stream::knows(self.outlook.feed(), slot) {
            return Ok(());
        }
        stream::entry(&directory, slot, Besides::Voters).map(|_| ())
    }

    /// Cuts a port's connections, and says so where there were none.
    fn cut(&self, name: &PortName) -> Result<Value, Refusal> {
        let directory = self.directory(&name.slot)?;
        let is_port = |port: &Value| {
            let rest = port["port"].as_str().and_then(|own| own.strip_prefix(name.port.as_str()));
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        // Its methods, where it is a service. One that a component added by itself is not known here.
        let mut known = ports_of(&directory, &name.slot).unwrap_or_default();
        known.retain(is_port);
        let is_loose = |port: &Value| port["connections"].as_array().is_none_or(Vec::is_empty);
        let answer = wired(name, wiring::disconnect(registry::shared(), name.into()))?;
        match known.first() {
            Some(first) if known.iter().all(is_loose) => Err(Refusal::OrderRefused(no_connection(name, first))),
            _ => Ok(answer),
        }
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
        let own = || stream::owner(&directory, name).map(|entry| &entry.slot);
        let slot = Some(ports::shared().slot()).filter(|slot| slot.name == name.slot).map_or_else(own, Ok)?;
        let is_it =
            |port: &Value| port["port"] == *name.port || (port["known_as"] == *name.port && !name.port.is_empty());
        let found = views::ports(slot, &directory.wires()).into_iter().find(is_it);
        let own = |port: &Value| port["port"].as_str().and_then(|own| views::port_layout(slot, own));
        let missing = || Refusal::NoSuchPort(name.clone(), directory::missing_port(slot, &name.port));
        let (port, layout) = found.and_then(|port| own(&port).map(|layout| (port, layout))).ok_or_else(missing)?;
        Ok(json!({"port": shown.unwrap_or(port), "layout": layout}))
    }
}

/// Why nobody is to ask for more than looking.
const STARTING: &str = "the daemon is starting: ask again";

/// That a port has nothing to disconnect.
fn no_connection(PortName { slot, port }: &PortName, shown: &Value) -> String {
    let heard = shown["heard_by"].as_array().into_iter().flatten().map(views::cell).collect::<Vec<_>>().join(", ");
    let heard = if heard.is_empty() { heard } else { format!("; {heard} hears it, as the profiles say") };
    format!("`{slot}.{port}` has no connection: there is nothing to disconnect{heard}")
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
