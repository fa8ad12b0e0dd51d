//! Where plugins' port calls arrive: handles become safe calls.
//!
//! A handle is the address of a [`Binding`](crate::port::border::Binding): one instance's access to one port of its slot. A binding is closed when its
//! instance is replaced and freed only when the instance was destroyed in order, so that a handle never dangles.
#![allow(unsafe_code, reason = "address of unsafe: a handle is an address that the daemon gave out")]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use component_sdk::abi::host::HostApi;
use component_sdk::abi::payload::{LoanResult, PortHandle, ReadMode, ReadResult};
use component_sdk::port::Sent;

use super::input::InPort;
use super::output::OutPort;
use crate::plugin::host;

/// One end of a slot's port.
#[derive(Clone)]
pub enum PortEnd {
    /// Receives.
    In(Arc<InPort>),
    /// Sends.
    Out(Arc<OutPort>),
}

/// One instance's access to one port.
pub struct Binding {
    end: PortEnd,
    closed: AtomicBool,
}

impl Binding {
    /// An open binding.
    #[must_use]
    pub fn new(end: PortEnd) -> Arc<Self> {
        Arc::new(Self { end, closed: AtomicBool::new(false) })
    }

    /// What the component is given. Valid as long as this binding is held.
    #[must_use]
    pub fn handle(self: &Arc<Self>) -> PortHandle {
        PortHandle(Arc::as_ptr(self).cast())
    }

    /// From now on every call says that the port is closed.
    pub fn close(&self) {
        self.closed.store(true, Ordering::Release);
    }

    fn input(&self) -> Option<&InPort> {
        match &self.end {
            PortEnd::In(port) if !self.closed.load(Ordering::Acquire) => Some(port),
            _ => None,
        }
    }

    fn output(&self) -> Option<&OutPort> {
        match &self.end {
            PortEnd::Out(port) if !self.closed.load(Ordering::Acquire) => Some(port),
            _ => None,
        }
    }
}

/// What every plugin is given.
pub static HOST: HostApi = HostApi {
    clock: host::clock_now,
    log: host::log,
    raise_fault: host::raise_fault,
    note_error: host::note_error,
    note_panic: host::note_panic,
    note_injection: host::note_injection,
    critical: host::critical,
    loan,
    publish,
    give_back,
    read,
    safe_output: host::safe_output,
};

fn binding<'a>(handle: PortHandle) -> &'a Binding {
    // SAFETY: components hold only handles that `Binding::handle` gave out, and a binding is held until its instance
    // was destroyed in order; that of an instance that was not is never freed.
    unsafe { &*handle.0.cast::<Binding>() }
}

extern "C" fn loan(handle: PortHandle) -> LoanResult {
    binding(handle).output().map_or(LoanResult::CLOSED, OutPort::loan)
}

extern "C" fn publish(handle: PortHandle, value: *mut u8) -> u32 {
    binding(handle).output().map_or(Sent::Closed, |port| port.publish(value)) as u32
}

extern "C" fn give_back(handle: PortHandle, value: *mut u8) {
    if let Some(port) = binding(handle).output() {
        port.give_back(value);
    }
}

extern "C" fn read(handle: PortHandle, mode: ReadMode) -> ReadResult {
    binding(handle).input().map_or(ReadResult::NONE, |port| port.read(mode))
}
