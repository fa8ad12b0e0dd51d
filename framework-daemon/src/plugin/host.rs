//! What a component's callbacks tell the daemon besides data: logs, panics, errors, faults.
//!
//! Each thread keeps what was told since its last callback began; [`crate::exec::callback`] takes it after a fault. All is
//! copied before anything is changed, so that a bad pointer of the plugin leaves nothing half-written or borrowed.

use std::cell::Cell;

use abi_stable::std_types::RStr;

use crate::model::fault::ShortText;
use crate::sys::{clock, log_ring};

/// A panic as the plugin's hook saw it.
#[derive(Clone, Copy)]
pub struct PanicNote {
    /// Message.
    pub message: ShortText,
    /// Source file.
    pub file: ShortText,
    /// Line.
    pub line: u32,
}

thread_local! {
    static SLOT: Cell<&'static str> = const { Cell::new("") };
    static PANIC: Cell<Option<PanicNote>> = const { Cell::new(None) };
    static ERROR: Cell<Option<ShortText>> = const { Cell::new(None) };
    static RAISED: Cell<Option<ShortText>> = const { Cell::new(None) };
    static INJECTED: Cell<Option<u64>> = const { Cell::new(None) };
}

/// Says whose callback runs on this thread from now on.
pub fn enter_slot(name: &'static str) {
    SLOT.set(name);
}

/// The panic since the last call.
#[must_use]
pub fn take_panic() -> Option<PanicNote> {
    PANIC.take()
}

/// The error text since the last call.
#[must_use]
pub fn take_error() -> Option<ShortText> {
    ERROR.take()
}

/// The fault that was raised since the last call.
#[must_use]
pub fn take_raised() -> Option<ShortText> {
    RAISED.take()
}

/// When a fault was provoked since the last call.
#[must_use]
pub fn take_injection() -> Option<u64> {
    INJECTED.take()
}

/// [`component_sdk::abi::host::HostApi::clock`].
pub extern "C" fn clock_now() -> u64 {
    clock::now_ns()
}

/// [`component_sdk::abi::host::HostApi::log`].
pub extern "C" fn log(level: u8, text: RStr<'_>) {
    log_ring::put(level, SLOT.get(), text.as_str());
}

/// [`component_sdk::abi::host::HostApi::raise_fault`].
pub extern "C" fn raise_fault(text: RStr<'_>) {
    let text = ShortText::new(text.as_str());
    RAISED.set(Some(text));
}

/// [`component_sdk::abi::host::HostApi::note_error`].
pub extern "C" fn note_error(text: RStr<'_>) {
    let text = ShortText::new(text.as_str());
    ERROR.set(Some(text));
}

/// [`component_sdk::abi::host::HostApi::note_panic`].
pub extern "C" fn note_panic(message: RStr<'_>, file: RStr<'_>, line: u32) {
    let note = PanicNote { message: ShortText::new(message.as_str()), file: ShortText::new(file.as_str()), line };
    PANIC.set(Some(note));
}

/// [`component_sdk::abi::host::HostApi::note_injection`].
pub extern "C" fn note_injection() {
    INJECTED.set(Some(clock::now_ns()));
}

/// [`component_sdk::abi::host::HostApi::critical`]: regions outside the instance are registered for checkpoints, which are
/// not active yet; the log says so.
pub extern "C" fn critical(name: RStr<'_>, _address: *mut u8, _len: usize) {
    log_ring::put(4, SLOT.get(), name.as_str());
}
