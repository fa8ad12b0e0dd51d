//! Interned names. A slot's name is needed where nothing may allocate and by threads that may outlive the slot.

use std::collections::HashSet;
use std::sync::Mutex;

static NAMES: Mutex<Option<HashSet<&'static str>>> = Mutex::new(None);

/// The slot whose ports are the fault manager's; no component has its name.
pub const FAULT_MANAGER: &str = "fault_manager";

/// The one copy of `name` that lives as long as the process. Bounded by the number of distinct names.
#[must_use]
pub fn intern(name: &str) -> &'static str {
    let mut names = NAMES.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let names = names.get_or_insert_with(HashSet::new);
    if let Some(known) = names.get(name) {
        return known;
    }
    let leaked: &'static str = Box::leak(name.to_owned().into_boxed_str());
    names.insert(leaked);
    leaked
}
