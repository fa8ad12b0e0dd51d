//! What a component tells of its devices, crossing the border.

use abi_stable::StableAbi;
use abi_stable::std_types::RStr;

/// What a plugin may call about devices, on any thread that is a callback's, a task's, or was started by one.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct DeviceApi {
    /// A device does not work: its name, why, and the system's error number; 0: it is none of the system's.
    pub lost: extern "C" fn(device: RStr<'_>, message: RStr<'_>, os_error: i32),
    /// A device works.
    pub found: extern "C" fn(device: RStr<'_>),
}

impl DeviceApi {
    /// Of a host that is not there.
    pub const CLOSED: Self = Self { lost: closed_lost, found: closed_found };
}

extern "C" fn closed_lost(_: RStr<'_>, _: RStr<'_>, _: i32) {}

extern "C" fn closed_found(_: RStr<'_>) {}
