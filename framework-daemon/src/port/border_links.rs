//! Where plugins' wiring arrives: names become connections.
//!
//! Names and reason lie in the plugin's memory: all is read before anything is locked, and the reason is written when
//! nothing is any more.

use std::fmt;

use abi_stable::std_types::RStr;
use component_sdk::abi::links::{LinkApi, PortName, Reason};
use component_sdk::abi::payload::PortHandle;
use component_sdk::status::Status;

use super::border::{End, make_sure_of_stack, visit};
use super::exchange::Busy;
use super::registry::{self, Entry};
use super::wiring::{self, Name, Refusal};
use crate::model::limits::LABEL_BYTES;
use crate::model::text::{Label, ShortText};
use crate::sys::{latch, log_ring, seat};

/// What every plugin is given.
pub(super) const API: LinkApi = LinkApi { connect, disconnect, join, part, add, remove };

extern "C" fn connect(one: PortName<'_>, other: PortName<'_>, reason: &mut Reason) -> u32 {
    make_sure_of_stack();
    let (one, other) = (Copied::of(one), Copied::of(other));
    let result = wiring_allowed([one.name(), other.name()]);
    let result = result.and_then(|()| wiring::connect(registry::shared(), one.name(), other.name()));
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

extern "C" fn join(own: PortHandle, to: PortName<'_>, reason: &mut Reason) -> u32 {
    make_sure_of_stack();
    let to = Copied::of(to);
    let result = entry(own).and_then(|entry| {
        wiring_allowed([name_of(&entry), to.name()])?;
        wiring::connect_end(registry::shared(), &entry.end, name_of(&entry), to.name())?;
        tell(ShortText::of(format_args!("connected {} and {}", name_of(&entry), to.name())));
        Ok(())
    });
    answer(result, reason)
}

extern "C" fn part(own: PortHandle, reason: &mut Reason) -> u32 {
    let result = entry(own).and_then(|entry| {
        wiring::disconnect_end(&entry.end, name_of(&entry))?;
        tell(ShortText::of(format_args!("disconnected {}", name_of(&entry))));
        Ok(())
    });
    answer(result, reason)
}

extern "C" fn add(own: PortHandle, name: RStr<'_>, reason: &mut Reason) -> u32 {
    make_sure_of_stack();
    let (name, is_whole) = (Label::new(name.as_str()), name.len() <= LABEL_BYTES);
    let result = entry(own).and_then(|entry| {
        let wanted = name.as_str();
        if !is_whole || wanted.is_empty() || wanted.contains('.') {
            let why = format_args!("{}: `{wanted}` is no name for a port", name_of(&entry));
            return Err(Refusal::new(Status::Error, why));
        }
        let slot = entry.slot;
        named(&entry, Some(name), format_args!("{}: slot {slot} has another port {wanted}", name_of(&entry)))
    });
    answer(result, reason)
}

extern "C" fn remove(own: PortHandle, reason: &mut Reason) -> u32 {
    answer(entry(own).and_then(|entry| named(&entry, None, format_args!(""))), reason)
}

/// While the emergency stop is latched nothing is connected to an actuator: whatever is wired then drives it at once when it is
/// cleared, and nobody has looked at that.
fn wiring_allowed(ends: [Name<'_>; 2]) -> Result<(), Refusal> {
    let actuator = ends.iter().find(|end| latch::guards(end.slot)).filter(|_| latch::is_set());
    let refused = |end: &Name<'_>| {
        let why = format_args!(
            "the emergency stop is latched, and {} is an actuator: `framework-daemon fault clear` first",
            end.slot
        );
        Refusal::new(Status::NotAllowed, why)
    };
    actuator.map_or(Ok(()), |end| Err(refused(end)))
}

/// Others find the port by that name from now on.
fn named(entry: &Entry, name: Option<Label>, taken: fmt::Arguments<'_>) -> Result<(), Refusal> {
    registry::shared().list(entry, name).map_err(|status| match status {
        Status::PortAlreadyUsed => Refusal::new(status, taken),
        _ => Refusal::new(status, format_args!("{}: names are being changed all the time", name_of(entry))),
    })
}

fn name_of(entry: &Entry) -> Name<'_> {
    Name { slot: entry.slot, port: entry.end.name() }
}

/// A port of the caller's own.
fn entry(own: PortHandle) -> Result<Entry, Refusal> {
    let refusal = |status: Status| Refusal::new(status, format_args!("{status}"));
    // The handle's port is known by its address when nobody is inside any more: names and connections have locks.
    let address = visit(own, |end, borrower| match end {
        End::Closed => Err(Status::Closed),
        _ if !borrower.may_call() => Err(Status::NotAllowed),
        // An instance that stands ready is not connected.
        _ => end.address().ok_or(Status::Disconnected),
    });
    let found = registry::shared().at(seat::owner().slot, address.map_err(refusal)?);
    let found = found.map_err(|Busy| refusal(Status::Error))?;
    found.ok_or_else(|| Refusal::new(Status::Disconnected, format_args!("the slot is not part of the running system")))
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
