//! Connections made and cut at run time, crossing the border by name.

use abi_stable::StableAbi;
use abi_stable::std_types::RStr;

use super::payload::PortHandle;
use crate::context::TEXT_LIMIT;
use crate::status::Status;

/// A port, by name.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct PortName<'a> {
    /// Its slot.
    pub slot: RStr<'a>,
    /// The port.
    pub port: RStr<'a>,
}

/// Where the host writes why it refused.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct Reason {
    /// Text, UTF-8.
    pub bytes: [u8; TEXT_LIMIT],
    /// How much of it.
    pub len: usize,
}

impl Reason {
    /// None.
    pub const NONE: Self = Self { bytes: [0; TEXT_LIMIT], len: 0 };
}

/// What a plugin may call to wire ports. Each returns 0 or the code of a [`Status`].
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct LinkApi {
    /// Connects two ports, whichever is named first.
    pub connect: for<'a> extern "C" fn(one: PortName<'a>, other: PortName<'a>, reason: &mut Reason) -> u32,
    /// Cuts all connections of a port.
    pub disconnect: for<'a> extern "C" fn(port: PortName<'a>, reason: &mut Reason) -> u32,
    /// Connects a port of the caller's own.
    pub join: for<'a> extern "C" fn(own: PortHandle, to: PortName<'a>, reason: &mut Reason) -> u32,
    /// Cuts all connections of a port of the caller's own.
    pub part: extern "C" fn(own: PortHandle, reason: &mut Reason) -> u32,
    /// Gives a port of the caller's own the name by which others wire it.
    pub add: for<'a> extern "C" fn(own: PortHandle, name: RStr<'a>, reason: &mut Reason) -> u32,
    /// From now on others do not find that port.
    pub remove: extern "C" fn(own: PortHandle, reason: &mut Reason) -> u32,
}

impl LinkApi {
    /// Of a host that is not there.
    pub const CLOSED: Self = Self {
        connect: closed_connect,
        disconnect: closed_disconnect,
        join: closed_join,
        part: closed_own,
        add: closed_add,
        remove: closed_own,
    };
}

extern "C" fn closed_connect(_: PortName<'_>, _: PortName<'_>, _: &mut Reason) -> u32 {
    Status::Closed.code()
}

extern "C" fn closed_disconnect(_: PortName<'_>, _: &mut Reason) -> u32 {
    Status::Closed.code()
}

extern "C" fn closed_join(_: PortHandle, _: PortName<'_>, _: &mut Reason) -> u32 {
    Status::Closed.code()
}

extern "C" fn closed_add(_: PortHandle, _: RStr<'_>, _: &mut Reason) -> u32 {
    Status::Closed.code()
}

extern "C" fn closed_own(_: PortHandle, _: &mut Reason) -> u32 {
    Status::Closed.code()
}
