//! Components that do what the shield is there for, beside one that has nothing to do with it.

use crate::profiles::{Profiles, application, plugin_dir, slot};
use crate::running::Running;

const RULES: &str = "<fault_tolerance><severity>reset</severity><reset limit=\"2\" within=\"60s\"/></fault_tolerance>";

/// A slot that does that deed.
#[must_use]
pub fn doer(name: &str, deed: &str, inside: &str) -> String {
    let property = format!("<properties><property name=\"deed\" type=\"string\">{deed}</property></properties>");
    slot(name, "Shielded", &format!("{property}{inside}{RULES}"))
}

/// These, beside one on an executor of its own.
#[must_use]
pub fn beside(doers: &[String]) -> Profiles {
    let slots: Vec<String> = doers.iter().cloned().chain([slot("ticker", "Ticker", "")]).collect();
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libshielded.so"));
    profiles
}

/// One named `culprit`.
#[must_use]
pub fn alone(deed: &str) -> Profiles {
    beside(&[doer("culprit", deed, "")])
}

/// The one beside them works, and had no fault.
///
/// # Panics
/// When it does not, or had one.
pub fn the_other_goes_on(daemon: &mut Running) {
    let slots = daemon.stop();
    let other = slots.iter().find(|slot| slot["slot"] == "ticker").expect("it is in the summary");
    let works = other["state"] == "active" && other["faults"] == 0 && other["cycles"].as_u64() > Some(0);
    assert!(works, "{other}; the log:\n{}", daemon.log());
}
