//! What a component's callbacks tell the daemon besides data: logs, panics, errors, faults.
//!
//! Each thread keeps what was told since its last callback began; [`crate::exec::callback`] takes it after a fault. All is
//! copied before anything is changed, so that a bad pointer of the plugin leaves nothing half-written or borrowed.

use std::cell::Cell;

use abi_stable::std_types::{RSlice, RStr};

use crate::model::fault::{Evidence, Label, ShortText};
use crate::model::limits::{REGIONS_PER_CALLBACK, SAFE_OUTPUT_BYTES, WAIT_MAX};
use crate::model::time::nanoseconds;
use crate::sys::seat::{self, Note};
use crate::sys::{clock, fiber, foreign, log_ring, safe_outputs, shield};

/// A panic as the plugin's hook saw it.
#[derive(Clone, Copy)]
pub struct PanicNote {
    /// Message.
    pub message: ShortText,
    /// Source file.
    pub file: Label,
    /// Line.
    pub line: u32,
}

/// Memory that the component wants in its checkpoint.
#[derive(Clone, Copy)]
pub struct RegionNote {
    /// What it is called.
    pub name: ShortText,
    /// Where it lies.
    pub address: usize,
    /// Its size in bytes.
    pub len: usize,
}

thread_local! {
    static PANIC: Cell<Option<PanicNote>> = const { Cell::new(None) };
    static ERROR: Cell<Option<ShortText>> = const { Cell::new(None) };
    static RAISED: Cell<Option<ShortText>> = const { Cell::new(None) };
    static REGIONS: [Cell<Option<RegionNote>>; REGIONS_PER_CALLBACK] = const { [const { Cell::new(None) }; REGIONS_PER_CALLBACK] };
    static REGION_COUNT: Cell<usize> = const { Cell::new(0) };
    static INJECTED: Cell<u64> = const { Cell::new(0) };
}

/// Forgets all that was told; returns when a fault was provoked.
pub fn forget() -> Option<u64> {
    if seat::take(Note::Told) {
        PANIC.set(None);
        ERROR.set(None);
        RAISED.set(None);
    }
    seat::take(Note::Injected).then(|| INJECTED.get())
}

/// Forgets the regions that were registered and not taken.
pub fn forget_regions() {
    if seat::take(Note::Region) {
        REGION_COUNT.set(0);
    }
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

/// A region that was registered since the last callback began.
#[must_use]
#[inline(never)]
pub fn take_region() -> Option<RegionNote> {
    let Some(last) = REGION_COUNT.get().checked_sub(1) else {
        seat::take(Note::Region);
        return None;
    };
    REGION_COUNT.set(last);
    REGIONS.with(|regions| regions[last].take())
}

/// The fault that was raised since the last call.
#[must_use]
pub fn take_raised() -> Option<ShortText> {
    RAISED.take()
}

/// [`component_sdk::abi::host::HostApi::clock`].
pub extern "C" fn clock_now() -> u64 {
    clock::now_ns()
}

/// [`component_sdk::abi::host::HostApi::sleep`].
pub extern "C" fn sleep(nanos: u64) -> bool {
    let until_ns = clock::now_ns() + nanos.min(nanoseconds(WAIT_MAX));
    while clock::now_ns() < until_ns {
        if fiber::park(until_ns).is_err() {
            return false;
        }
    }
    true
}

/// [`component_sdk::abi::host::HostApi::log`].
pub extern "C" fn log(level: u8, text: RStr<'_>) {
    log_ring::put(level, seat::owner().slot, text.as_str());
}

/// [`component_sdk::abi::host::HostApi::raise_fault`].
pub extern "C" fn raise_fault(text: RStr<'_>) {
    let text = ShortText::new(text.as_str());
    RAISED.set(Some(text));
    seat::leave(Note::Told);
}

/// [`component_sdk::abi::host::HostApi::note_error`].
pub extern "C" fn note_error(text: RStr<'_>) {
    let text = ShortText::new(text.as_str());
    ERROR.set(Some(text));
    seat::leave(Note::Told);
}

/// [`component_sdk::abi::host::HostApi::note_panic`].
pub extern "C" fn note_panic(message: RStr<'_>, file: RStr<'_>, line: u32) {
    let note = PanicNote { message: ShortText::new(message.as_str()), file: Label::end_of(file.as_str()), line };
    shield::leave::note_panic(note.message.as_str());
    if foreign::is_here() {
        // No callback will ask for it.
        return foreign::panicked(Evidence::Panic { message: note.message, file: note.file, line });
    }
    PANIC.set(Some(note));
    seat::leave(Note::Told);
}

/// [`component_sdk::abi::host::HostApi::note_injection`].
pub extern "C" fn note_injection() {
    INJECTED.set(clock::now_ns());
    seat::leave(Note::Injected);
}

/// [`component_sdk::abi::host::HostApi::critical`].
pub extern "C" fn critical(name: RStr<'_>, address: *mut u8, len: usize) {
    let note = RegionNote { name: ShortText::new(name.as_str()), address: address.expose_provenance(), len };
    let place = REGION_COUNT.get();
    if place < REGIONS_PER_CALLBACK {
        REGIONS.with(|regions| regions[place].set(Some(note)));
        REGION_COUNT.set(place + 1);
        seat::leave(Note::Region);
    } else {
        log_ring::put(2, seat::owner().slot, "too many critical regions in one callback: one is not in the checkpoint");
    }
}

/// [`component_sdk::abi::host::HostApi::safe_output`].
pub extern "C" fn safe_output(fd: i32, bytes: RSlice<'_, u8>) {
    let (mut copy, len) = ([0; SAFE_OUTPUT_BYTES + 1], bytes.len().min(SAFE_OUTPUT_BYTES + 1));
    copy[..len].copy_from_slice(&bytes.as_slice()[..len]);
    if let Err(refused) = safe_outputs::set(seat::owner().slot, fd, &copy[..len]) {
        log_ring::put(1, seat::owner().slot, ShortText::of(format_args!("{refused}")).as_str());
    }
}
