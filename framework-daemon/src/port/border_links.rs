//! Where plugins' wiring arrives: names become connections.
//!
//! Names and reason lie in the plugin's memory: all is read before anything is locked, and the reason is written when
//! nothing is any more.

use component_sdk::abi::links::{LinkApi, PortName, Reason};

use super::border::make_sure_of_stack;
use super::registry;
use super::wiring::{self, Name, Refusal};
use crate::model::text::{Label, ShortText};
use crate::sys::{log_ring, seat};

/// What every plugin is given.
pub(super) const API: LinkApi = LinkApi { connect, disconnect };

extern "C" fn connect(one: PortName<'_>, other: PortName<'_>, reason: &mut Reason) -> u32 {
    make_sure_of_stack();
    let (one, other) = (Copied::of(one), Copied::of(other));
    let result = wiring::connect(registry::shared(), one.name(), other.name());
    if result.is_ok() {
        tell(ShortText::of(format_args!("connected {} and {}", one.name(), other.name())));
    }
    answer(result, reason)
}

extern "C" fn disconnect(port: PortName<'_>, reason: &mut Reason) -> u32 {
    make_sure_of_stack();
    let port = Copied::of(port);
    let result = wiring::disconnect(registry::shared(), port.name());
    if result.is_ok() {
        tell(ShortText::of(format_args!("disconnected {}", port.name())));
    }
    answer(result, reason)
}

/// Who wires is worth knowing: afterwards the profiles alone do not tell what is connected.
fn tell(text: ShortText) {
    log_ring::put(3, seat::owner().slot, text.as_str());
}

/// A name out of the plugin's memory.
struct Copied {
    slot: Label,
    port: Label,
}

impl Copied {
    fn of(name: PortName<'_>) -> Self {
        Self { slot: Label::new(name.slot.as_str()), port: Label::new(name.port.as_str()) }
    }

    fn name(&self) -> Name<'_> {
        Name { slot: self.slot.as_str(), port: self.port.as_str() }
    }
}

fn answer(result: Result<(), Refusal>, reason: &mut Reason) -> u32 {
    let Err(refusal) = result else { return 0 };
    let text = refusal.reason.as_str().as_bytes();
    let len = text.len().min(reason.bytes.len());
    reason.bytes[..len].copy_from_slice(&text[..len]);
    reason.len = len;
    refusal.code()
}
