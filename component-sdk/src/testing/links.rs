//! Wiring on the bench: nothing refuses, and what was asked for is kept.

use abi_stable::std_types::RStr;

use super::{RECORD, port};
use crate::abi::links::{LinkApi, PortName, Reason};
use crate::abi::payload::PortHandle;
use crate::status::Status;

pub(super) const API: LinkApi = LinkApi { connect, disconnect, join, part, add, remove };

fn keep(text: String) -> u32 {
    RECORD.with_borrow_mut(|record| record.wirings.push(text));
    0
}

/// About a port of the component's own, by its name.
fn keep_of(handle: PortHandle, text: impl FnOnce(RStr<'static>) -> String) -> u32 {
    port(handle).map_or(Status::Closed.code(), |port| keep(text(port.borrow().name)))
}

extern "C" fn connect(one: PortName<'_>, other: PortName<'_>, _: &mut Reason) -> u32 {
    keep(format!("{}.{} - {}.{}", one.slot, one.port, other.slot, other.port))
}

extern "C" fn disconnect(port: PortName<'_>, _: &mut Reason) -> u32 {
    keep(format!("{}.{} -", port.slot, port.port))
}

extern "C" fn join(handle: PortHandle, to: PortName<'_>, _: &mut Reason) -> u32 {
    keep_of(handle, |own| format!("{own} - {}.{}", to.slot, to.port))
}

extern "C" fn part(handle: PortHandle, _: &mut Reason) -> u32 {
    keep_of(handle, |own| format!("{own} -"))
}

extern "C" fn add(handle: PortHandle, name: RStr<'_>, _: &mut Reason) -> u32 {
    keep_of(handle, |own| format!("{own} = {name}"))
}

extern "C" fn remove(handle: PortHandle, _: &mut Reason) -> u32 {
    keep_of(handle, |own| format!("{own} ="))
}
