//! Bad pointers handed to the host's functions: handles that nobody gave out, values and texts that are not there.

use std::ptr::{without_provenance, without_provenance_mut};

use component_sdk::abi::host::{self, HostApi};
use component_sdk::abi::payload::{PortHandle, ReadMode};
use component_sdk::prelude::*;

use super::bystander::Beat;

/// Where nothing is mapped.
const BAD: usize = 64;

/// The text type of the host's functions, made of a bad pointer.
macro_rules! bad_text {
    () => {
        // SAFETY: none; whoever reads it faults, which is its purpose.
        unsafe { std::str::from_utf8_unchecked(std::slice::from_raw_parts(without_provenance(BAD), 100)) }.into()
    };
}

fn host() -> &'static HostApi {
    host::get()
}

const fn forged() -> PortHandle {
    PortHandle(without_provenance(BAD))
}

torture! {
    /// Borrows a block of a port that there is none of.
    ForgedLoan => || _ = (host().loan)(forged());

    /// Publishes to a port that there is none of.
    ForgedPublish => || _ = (host().publish)(forged(), without_provenance_mut(BAD));

    /// Gives a block back to a port that there is none of.
    ForgedGiveBack => || (host().give_back)(forged(), without_provenance_mut(BAD));

    /// Reads a port that there is none of.
    ForgedRead => || _ = (host().read)(forged(), ReadMode::Newest);

    /// Logs a text that is not there.
    BadLogText => || (host().log)(3, bad_text!());

    /// Raises a fault with a text that is not there.
    BadRaiseText => || (host().raise_fault)(bad_text!());

    /// Loses a device whose name is not there.
    BadDeviceName => || (host().devices.lost)(bad_text!(), "gone".into(), 0);

    /// Finds one.
    BadDeviceFound => || (host().devices.found)(bad_text!());

    /// Tells an error text that is not there.
    BadErrorText => || (host().note_error)(bad_text!());

    /// Tells a panic whose message and file are not there.
    BadPanicText => || (host().note_panic)(bad_text!(), bad_text!(), 1);

    /// Registers a region whose name is not there.
    BadCriticalName => || (host().critical)(bad_text!(), without_provenance_mut(BAD), 8);

    /// Registers a safe output whose bytes are not there.
    BadSafeOutput => || {
        // SAFETY: none; whoever reads them faults, which is its purpose.
        let bytes: &[u8] = unsafe { std::slice::from_raw_parts(without_provenance(BAD), 16) };
        (host().safe_output)(2, bytes.into());
    };

    /// Registers a region that is not there, then faults: whoever saves or restores it meets it.
    BadCriticalRegion => || {
        (host().critical)("region".into(), without_provenance_mut(BAD), 1 << 20);
        super::memory::write(24);
    };
}

/// Defines component classes with an output port that strike by the function given.
macro_rules! with_port {
    ($($(#[$doc:meta])* $class:ident => $strike:expr;)+) => {$(
        $(#[$doc])*
        #[derive(Component)]
        #[component(version = "1.0", periodic = "1ms")]
        pub struct $class {
            #[port]
            said: DataOut<Beat>,
            /// Good cycles before the strike.
            #[property(default = 5)]
            after: u64,
            /// Strikes of this class in a process.
            #[property(default = 1000000000)]
            limit: u64,
            cycles: u64,
        }

        impl Callbacks for $class {
            fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
                static STRIKES: crate::Strikes = crate::Strikes::new();
                self.cycles += 1;
                self.said.write(Beat { number: self.cycles });
                if self.cycles > self.after {
                    self.cycles = 0;
                    if STRIKES.take(self.limit, cx) {
                        ($strike)(&mut self.said);
                    }
                }
                Ok(())
            }
        }
    )+};
}

with_port! {
    /// Publishes a value that was never lent to it.
    BadPublishValue => |port: &mut DataOut<Beat>| {
        let handle = handle(port);
        let _ = (host().loan)(handle);
        let _ = (host().publish)(handle, without_provenance_mut(BAD));
    };

    /// Gives back a value that was never lent to it.
    BadGiveBackValue => |port: &mut DataOut<Beat>| {
        let handle = handle(port);
        let _ = (host().loan)(handle);
        (host().give_back)(handle, without_provenance_mut(BAD));
    };

    /// Writes to a port when its stack is nearly exhausted: the stack ends in the host's own code.
    StackEndWrite => |port: &mut DataOut<Beat>| _ = std::hint::black_box(deeper(port, 0));
}

fn handle(port: &DataOut<Beat>) -> PortHandle {
    const { assert!(size_of::<DataOut<Beat>>() == size_of::<PortHandle>()) };
    // SAFETY: a port end is its handle and nothing else.
    unsafe { std::mem::transmute_copy(port) }
}

#[inline(never)]
#[allow(unconditional_recursion, reason = "the stack is to overflow")]
fn deeper(port: &mut DataOut<Beat>, depth: u64) -> u64 {
    port.write(Beat { number: depth });
    1 + deeper(port, std::hint::black_box(depth + 1))
}
