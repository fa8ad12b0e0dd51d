//! Ports by name: what `connect` and `disconnect` look up. Read from any thread without waiting; ports are replaced as a whole
//! by boot and reload, the names by which components want their own to be found are laid over them.
//!
//! Names lie apart from the ports, so that a component that changes one never drops somebody's port: what ports hold may have to
//! be freed by a plugin's code.

use std::sync::{Arc, LazyLock};

use component_sdk::status::Status;

use super::border::PortEnd;
use super::exchange::{Busy, Exchange};
use crate::model::text::Label;

/// One port of the running system.
#[derive(Clone)]
pub struct Entry {
    /// Its slot.
    pub slot: &'static str,
    /// The port.
    pub end: PortEnd,
    /// Others find it by its own name, as long as its component does not say otherwise.
    pub is_listed: bool,
}

impl Entry {
    fn key(&self) -> (&str, &str) {
        (self.slot, self.end.name())
    }
}

/// A port of a composite: another name for ports of the slots in it.
#[derive(Clone)]
pub struct Export {
    /// The composite.
    pub composite: String,
    /// The port's name there.
    pub port: String,
    /// What it is: one, or several readers; none where it is a service with methods.
    pub ends: Vec<PortEnd>,
    /// The slot's service that it is: slot and name.
    pub service: Option<(String, String)>,
}

/// All ports of the running system, in the order of their own names.
#[derive(Default)]
struct Ports {
    entries: Vec<Entry>,
    exports: Vec<Export>,
}

/// Counted: what is looked at stays, though the pin is let go.
type Directory = Arc<Ports>;

/// The ports that a name leads to: one; or those that a composite shows by one name, at least one.
pub enum Found {
    /// A slot's.
    One(PortEnd),
    /// A composite's, by its place among the exports.
    Exported(Exported),
}

/// Ports that a composite shows by one name.
pub struct Exported(Directory, usize);

impl Found {
    /// Each of them.
    #[must_use]
    pub fn ends(&self) -> &[PortEnd] {
        match self {
            Self::One(end) => std::slice::from_ref(end),
            Self::Exported(Exported(directory, place)) => {
                directory.exports.get(*place).map_or(&[], |export| export.ends.as_slice())
            }
        }
    }
}

/// What a component said about a port of its own.
#[derive(Clone)]
struct Listing {
    slot: &'static str,
    address: usize,
    /// How others find it; if not at all, none.
    name: Option<Label>,
}

/// The ports of a running system.
pub struct Registry {
    ports: Exchange<Directory>,
    listings: Exchange<Arc<Vec<Listing>>>,
}

impl Default for Registry {
    fn default() -> Self {
        Self { ports: Exchange::new(Directory::default()), listings: Exchange::new(Arc::default()) }
    }
}

/// The ports of the system that runs in this process.
pub fn shared() -> &'static Arc<Registry> {
    static SHARED: LazyLock<Arc<Registry>> = LazyLock::new(Arc::default);
    &SHARED
}

/// Why a name leads to no port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// There is no such slot, or none with ports.
    Slot,
    /// The slot has no such port.
    Port,
    /// Too many threads look at the same time.
    Busy,
}

impl From<Busy> for Unknown {
    fn from(Busy: Busy) -> Self {
        Self::Busy
    }
}

impl Registry {
    /// From now on these are the ports. Port names of a slot are unique. A port that was there before keeps the name that its
    /// component gave it.
    ///
    /// # Errors
    /// Somebody else sets them all the time.
    pub fn set(&self, entries: Vec<Entry>) -> Result<(), Busy> {
        self.set_all(entries, Vec::new())
    }

    /// As [`Self::set`], with the ports that composites show.
    ///
    /// # Errors
    /// Somebody else sets them all the time.
    pub fn set_all(&self, mut entries: Vec<Entry>, exports: Vec<Export>) -> Result<(), Busy> {
        entries.sort_by(|one, other| one.key().cmp(&other.key()));
        let fresh = Arc::new(Ports { entries, exports });
        let stays = |listing: &Listing| fresh.entries.iter().any(|entry| entry.end.address() == listing.address);
        self.listings.edit(|listings| Arc::new(listings.iter().filter(|one| stays(one)).cloned().collect()))?;
        // What is stale is dropped here, outside.
        self.ports.edit(|_| Arc::clone(&fresh)).map(drop)
    }

    /// The ports of that name.
    ///
    /// # Errors
    /// Why none is found.
    pub fn find(&self, slot: &str, port: &str) -> Result<Found, Unknown> {
        let directory = self.ports.visit(Arc::clone)?;
        let listings = self.listings.visit(Arc::clone)?;
        let ports = of_slot(&directory.entries, slot);
        if ports.is_empty() {
            return exported(directory, &listings, slot, port);
        }
        let given = |listing: &&Listing| listing.slot == slot && listing.name.is_some_and(|name| name.as_str() == port);
        if let Some(listing) = listings.iter().find(given) {
            let found = ports.iter().find(|entry| entry.end.address() == listing.address);
            return found.map(|entry| Found::One(entry.end.clone())).ok_or(Unknown::Port);
        }
        let own = ports.binary_search_by(|entry| entry.end.name().cmp(port)).ok().map(|index| &ports[index]);
        let own = own.filter(|entry| entry.is_listed && !is_in(&listings, entry));
        own.map(|entry| Found::One(entry.end.clone())).ok_or(Unknown::Port)
    }

    /// The slot's service that a composite shows by that name: slot and name.
    #[must_use]
    pub fn service(&self, composite: &str, port: &str) -> Option<(String, String)> {
        let directory = self.ports.visit(Arc::clone).ok()?;
        let mut exports = directory.exports.iter();
        exports.find(|export| export.composite == composite && export.port == port)?.service.clone()
    }

    /// The port at that address, whether others find it or not.
    ///
    /// # Errors
    /// Too many threads look at the same time.
    pub fn at(&self, slot: &str, address: usize) -> Result<Option<Entry>, Busy> {
        let directory = self.ports.visit(Arc::clone)?;
        Ok(of_slot(&directory.entries, slot).iter().find(|entry| entry.end.address() == address).cloned())
    }

    /// From now on others find the port by this name, or not at all.
    ///
    /// # Errors
    /// `PortAlreadyUsed`; `Error`: others change names all the time.
    pub fn list(&self, entry: &Entry, name: Option<Label>) -> Result<(), Status> {
        let directory = self.ports.visit(Arc::clone).map_err(|Busy| Status::Error)?;
        let (slot, address) = (entry.slot, entry.end.address());
        let mut is_free = true;
        let edited = self.listings.edit(|listings| {
            is_free = name.is_none_or(|name| !is_taken(&directory.entries, listings, entry, name.as_str()));
            if !is_free {
                return Arc::clone(listings);
            }
            let others = listings.iter().filter(|listing| listing.address != address).cloned();
            Arc::new(others.chain([Listing { slot, address, name }]).collect())
        });
        edited.map_err(|Busy| Status::Error)?;
        if is_free { Ok(()) } else { Err(Status::PortAlreadyUsed) }
    }

    /// The name by which others find a port; `None`: by none.
    #[must_use]
    pub fn name_of(&self, entry: &Entry) -> Option<String> {
        let listings = self.listings.visit(Arc::clone).unwrap_or_default();
        match listings.iter().find(|listing| listing.address == entry.end.address()) {
            Some(listing) => listing.name.map(|name| name.as_str().to_owned()),
            None => entry.is_listed.then(|| entry.end.name().to_owned()),
        }
    }

    /// All ports, in the order of their own names.
    #[must_use]
    pub fn all(&self) -> Vec<Entry> {
        self.ports.visit(Arc::clone).unwrap_or_default().entries.clone()
    }
}

/// A composite's port. One that its component took the name from is not found by the composite's, either.
fn exported(directory: Directory, listings: &[Listing], slot: &str, port: &str) -> Result<Found, Unknown> {
    let mut own = directory.exports.iter().enumerate().filter(|(_, export)| export.composite == slot).peekable();
    let unknown = if own.peek().is_some() { Unknown::Port } else { Unknown::Slot };
    let is_hidden =
        |end: &PortEnd| listings.iter().any(|listing| listing.address == end.address() && listing.name.is_none());
    let is_it = |export: &Export| export.port == port && !export.ends.is_empty();
    let found = own.find(|(_, export)| is_it(export) && !export.ends.iter().any(is_hidden));
    let place = found.map(|(place, _)| place).ok_or(unknown)?;
    Ok(Found::Exported(Exported(directory, place)))
}

fn of_slot<'a>(directory: &'a [Entry], slot: &str) -> &'a [Entry] {
    let from = directory.partition_point(|entry| entry.slot < slot);
    let count = directory[from..].partition_point(|entry| entry.slot == slot);
    &directory[from..from + count]
}

fn is_in(listings: &[Listing], entry: &Entry) -> bool {
    listings.iter().any(|listing| listing.address == entry.end.address())
}

/// True when others find another port of the slot by that name.
fn is_taken(directory: &[Entry], listings: &[Listing], own: &Entry, name: &str) -> bool {
    let others = of_slot(directory, own.slot).iter().filter(|entry| entry.end.address() != own.end.address());
    let by_listing = |entry: &Entry| {
        let listing = listings.iter().find(|listing| listing.address == entry.end.address());
        listing.map(|listing| listing.name.is_some_and(|given| given.as_str() == name))
    };
    others.into_iter().any(|entry| by_listing(entry).unwrap_or(entry.is_listed && entry.end.name() == name))
}
