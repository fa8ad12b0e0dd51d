//! Ports by name: what `connect` and `disconnect` look up. Read from any thread without waiting, replaced as a whole by boot
//! and reload.

use std::sync::Arc;

use super::border::PortEnd;
use super::exchange::{Busy, Exchange};

/// One port of the running system.
#[derive(Clone)]
pub struct Entry {
    /// Its slot.
    pub slot: &'static str,
    /// The port.
    pub end: PortEnd,
}

impl Entry {
    fn key(&self) -> (&str, &str) {
        (self.slot, self.end.name())
    }
}

/// All ports of the running system, in the order of their names.
type Directory = Arc<Vec<Entry>>;

/// The ports of a running system.
pub struct Registry(Exchange<Directory>);

impl Default for Registry {
    fn default() -> Self {
        Self(Exchange::new(Directory::default()))
    }
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

impl Registry {
    /// From now on these are the ports. Port names of a slot are unique.
    ///
    /// # Errors
    /// Somebody else sets them all the time.
    pub fn set(&self, mut entries: Vec<Entry>) -> Result<(), Busy> {
        entries.sort_by(|one, other| one.key().cmp(&other.key()));
        let fresh = Arc::new(entries);
        // What is stale is dropped here, outside.
        self.0.edit(|_| fresh).map(drop)
    }

    /// The port of that name.
    ///
    /// # Errors
    /// Why it is not found.
    pub fn find(&self, slot: &str, port: &str) -> Result<PortEnd, Unknown> {
        // Counted: what is looked at meanwhile stays, though the pin is let go.
        let directory = self.0.visit(Arc::clone).map_err(|Busy| Unknown::Busy)?;
        match directory.binary_search_by(|entry| entry.key().cmp(&(slot, port))) {
            Ok(index) => Ok(directory[index].end.clone()),
            Err(index) => {
                // A port of the same slot lies beside the place where this one would be.
                let beside = [index.checked_sub(1), Some(index)].into_iter().flatten();
                let has_slot = beside.filter_map(|index| directory.get(index)).any(|entry| entry.slot == slot);
                Err(if has_slot { Unknown::Port } else { Unknown::Slot })
            }
        }
    }

    /// All ports, in the order of their names.
    #[must_use]
    pub fn all(&self) -> Arc<Vec<Entry>> {
        self.0.visit(Arc::clone).unwrap_or_default()
    }
}
