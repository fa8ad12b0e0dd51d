//! What a plugin may call. One table for each plugin, handed over once by `install`.
//!
//! A static in the plugin, not an argument of each call: `write` and `newest` are called too often to carry it.
#![allow(unsafe_code, reason = "address of unsafe: the plugin's one pointer to its host")]

use std::sync::atomic::{AtomicPtr, Ordering};

use abi_stable::StableAbi;
use abi_stable::std_types::{RSlice, RStr};

use super::calls::CallApi;
use super::device::DeviceApi;
use super::events::EventApi;
use super::links::LinkApi;
use super::payload::{LoanResult, PortHandle, ReadMode, ReadResult};
use super::push::PushApi;
use super::task::TaskApi;

/// The functions of the daemon.
///
/// None of them blocks a thread, allocates on the path of data, or holds a lock while it touches the plugin's memory.
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct HostApi {
    /// Monotonic time in nanoseconds.
    pub clock: extern "C" fn() -> u64,
    /// Log record: level 1 (error) to 4 (debug), text.
    pub log: extern "C" fn(level: u8, text: RStr<'_>),
    /// A fault of the component whose callback runs.
    pub raise_fault: extern "C" fn(text: RStr<'_>),
    /// The error text of the callback that is about to return `Error`.
    pub note_error: extern "C" fn(text: RStr<'_>),
    /// From the panic hook: message, file, line.
    pub note_panic: extern "C" fn(message: RStr<'_>, file: RStr<'_>, line: u32),
    /// A provoked fault happens with the next instruction.
    pub note_injection: extern "C" fn(),
    /// Region of a checkpoint: name, address, length.
    pub critical: extern "C" fn(name: RStr<'_>, address: *mut u8, len: usize),
    /// Lends a block of an output port.
    pub loan: extern "C" fn(port: PortHandle) -> LoanResult,
    /// Sends the block on loan; returns a [`crate::port::Sent`] code.
    pub publish: extern "C" fn(port: PortHandle, value: *mut u8) -> u32,
    /// Takes the block on loan back, unsent.
    pub give_back: extern "C" fn(port: PortHandle, value: *mut u8),
    /// Reads an input port; what is returned stays valid until the next read of this port.
    pub read: extern "C" fn(port: PortHandle, mode: ReadMode) -> ReadResult,
    /// Bytes that are written to a descriptor when the process dies; none: no longer.
    pub safe_output: extern "C" fn(fd: i32, bytes: RSlice<'_, u8>),
    /// Suspends the callback for that many nanoseconds; false: it was ended before, or may not wait.
    pub sleep: extern "C" fn(nanos: u64) -> bool,
    /// Queries.
    pub calls: CallApi,
    /// Events.
    pub events: EventApi,
    /// Connections made and cut at run time.
    pub links: LinkApi,
    /// Threads of a component.
    pub tasks: TaskApi,
    /// Push ports.
    pub pushes: PushApi,
    /// Devices lost and found.
    pub devices: DeviceApi,
}

static HOST: AtomicPtr<HostApi> = AtomicPtr::new(std::ptr::null_mut());

/// Sets the host of this plugin.
pub fn set(host: &'static HostApi) {
    HOST.store(std::ptr::from_ref(host).cast_mut(), Ordering::Release);
}

/// The host of this plugin; before `install`, one that does nothing.
#[must_use]
pub fn get() -> &'static HostApi {
    let host = HOST.load(Ordering::Acquire);
    // SAFETY: `set` is the only writer and stores a `&'static HostApi`; null means that it has not been called.
    unsafe { host.as_ref() }.unwrap_or(&DETACHED)
}

/// A host for code that runs before `install`: every port is closed.
static DETACHED: HostApi = HostApi {
    clock: detached::clock,
    log: detached::log,
    raise_fault: detached::text,
    note_error: detached::text,
    note_panic: detached::panic,
    note_injection: detached::nothing,
    critical: detached::critical,
    loan: detached::loan,
    publish: detached::publish,
    give_back: detached::give_back,
    read: detached::read,
    safe_output: detached::safe_output,
    sleep: detached::sleep,
    calls: CallApi::CLOSED,
    events: EventApi::CLOSED,
    links: LinkApi::CLOSED,
    tasks: TaskApi::CLOSED,
    pushes: PushApi::CLOSED,
    devices: DeviceApi::CLOSED,
};

mod detached {
    use super::{LoanResult, PortHandle, RSlice, RStr, ReadMode, ReadResult};

    pub(super) extern "C" fn clock() -> u64 {
        0
    }
    pub(super) extern "C" fn log(_: u8, _: RStr<'_>) {}
    pub(super) extern "C" fn text(_: RStr<'_>) {}
    pub(super) extern "C" fn panic(_: RStr<'_>, _: RStr<'_>, _: u32) {}
    pub(super) extern "C" fn nothing() {}
    pub(super) extern "C" fn critical(_: RStr<'_>, _: *mut u8, _: usize) {}
    pub(super) extern "C" fn loan(_: PortHandle) -> LoanResult {
        LoanResult::CLOSED
    }
    pub(super) extern "C" fn publish(_: PortHandle, _: *mut u8) -> u32 {
        3
    }
    pub(super) extern "C" fn give_back(_: PortHandle, _: *mut u8) {}
    pub(super) extern "C" fn read(_: PortHandle, _: ReadMode) -> ReadResult {
        ReadResult::NONE
    }
    pub(super) extern "C" fn safe_output(_: i32, _: RSlice<'_, u8>) {}
    pub(super) extern "C" fn sleep(_: u64) -> bool {
        false
    }
}
