//! Connections made and cut at run time, crossing the border by name.

use abi_stable::StableAbi;
use abi_stable::std_types::RStr;

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
}

impl LinkApi {
    /// Of a host that is not there.
    pub const CLOSED: Self = Self { connect: closed_connect, disconnect: closed_disconnect };
}

extern "C" fn closed_connect(_: PortName<'_>, _: PortName<'_>, _: &mut Reason) -> u32 {
    Status::Closed.code()
}

extern "C" fn closed_disconnect(_: PortName<'_>, _: &mut Reason) -> u32 {
    Status::Closed.code()
}
