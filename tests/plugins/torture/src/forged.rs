//! Queries and wiring with what nobody gave out: handles, numbers, names; from where nobody may ask.
//!
//! What the host must refuse is looked at here: where it does not, the component panics, and the campaign sees a fault that
//! must not be.

use std::ptr::{without_provenance, without_provenance_mut};
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};

use component_sdk::abi::calls::{CallApi, Lent, Wait, Whose};
use component_sdk::abi::host;
use component_sdk::abi::links::{PortName, Reason};
use component_sdk::abi::payload::PortHandle;
use component_sdk::prelude::*;

use super::bystander::Beat;

/// A moment, where a wait would begin.
const MOMENT: Wait = Wait(1_000_000);

fn calls() -> &'static CallApi {
    &host::get().calls
}

/// What each function says to this handle and number: four of the client's side, then five of the server's.
fn said(port: PortHandle, id: u64) -> [u32; 9] {
    let api = calls();
    // Whatever is lent where nothing must be lent is written to.
    let lent = |lent: Lent| {
        if lent.status == 0 {
            // SAFETY: lent; if it is not, the fault is what is looked for.
            unsafe { lent.value.write_bytes(0xa5, 8) };
        }
        lent.status
    };
    (api.release)(port, id);
    [
        (api.send)(port, id),
        lent((api.ask)(port, id, MOMENT)),
        lent((api.receive)(port, id, MOMENT)),
        (api.discard)(port, id),
        lent((api.next)(port, MOMENT)),
        lent((api.opened)(port, id)),
        lent((api.answer_loan)(port, id)),
        (api.answer)(port, id),
        (api.refuse)(port, id, 0),
    ]
}

fn refused(port: PortHandle, id: u64) {
    let said = said(port, id);
    assert!(said.iter().all(|status| *status != 0), "{said:?} to handle {port:?}, number {id:#x}");
}

/// As [`refused`], by the functions that take no number, too.
fn closed(port: PortHandle) {
    refused(port, 1 << 32);
    assert_ne!((calls().loan)(port).status, 0, "a loan of {port:?}");
    assert_ne!((calls().blocking)(port, Whose::Component, true), 0, "blocking of {port:?}");
}

fn handles_that_are_none(own: [PortHandle; 2]) {
    let here = 0u64;
    for bits in [0, 1, 64, 0xdead_beef, usize::MAX, usize::MAX << 32, (&raw const here).addr()] {
        closed(PortHandle(without_provenance(bits)));
    }
    // Those of everybody else: it is not their callback.
    for bits in (1..4usize).flat_map(|generation| (0..256).map(move |place| generation << 32 | place)) {
        let handle = PortHandle(without_provenance(bits));
        if own.iter().all(|own| own.0 != handle.0) {
            closed(handle);
        }
    }
}

fn numbers_that_are_none([ask, tell]: [PortHandle; 2]) {
    let lent = (calls().loan)(ask);
    assert_eq!(lent.status, 0, "there is a place");
    let numbers = [0, 1, u64::MAX, 1 << 32, u64::from(u32::MAX), lent.id + 1, lent.id + (1 << 32), lent.id ^ (1 << 63)];
    for id in numbers.into_iter().filter(|id| *id != lent.id) {
        refused(ask, id);
        refused(tell, id);
    }
    // It is as it was.
    assert_eq!((calls().discard)(ask, lent.id), 0);
    assert_ne!((calls().discard)(ask, lent.id), 0);
}

fn of_the_other_side([ask, tell]: [PortHandle; 2]) {
    let lent = (calls().loan)(ask);
    let not_allowed =
        |statuses: &[u32]| assert!(statuses.iter().all(|is| *is == Status::NotAllowed.code()), "{statuses:?}");
    not_allowed(&said(tell, lent.id)[..4]);
    assert_eq!((calls().discard)(ask, lent.id), 0, "nobody touched it");
    not_allowed(&said(ask, lent.id)[4..]);
}

fn on_a_thread(own: [PortHandle; 2]) {
    let own = own.map(|port| port.0.addr());
    let thread = std::thread::spawn(move || {
        for bits in own {
            closed(PortHandle(without_provenance(bits)));
        }
        calls_sleep()
    });
    assert_eq!(thread.join().ok(), Some(false), "nobody waits there");
}

fn calls_sleep() -> bool {
    (host::get().sleep)(1_000_000_000)
}

static ASKS: AtomicUsize = AtomicUsize::new(0);
static ENDS: AtomicU32 = AtomicU32::new(0);

extern "C" fn handler(_: i32) {
    let port = PortHandle(without_provenance(ASKS.load(Ordering::Relaxed)));
    let lent = (calls().loan)(port);
    let end = (calls().ask)(port, lent.id, MOMENT).status;
    ENDS.store(if calls_sleep() { 0 } else { end }, Ordering::Relaxed);
}

/// Nobody waits there, and the callback goes on where it was.
fn in_a_signal_handler([ask, _]: [PortHandle; 2]) {
    ASKS.store(ask.0.addr(), Ordering::Relaxed);
    // SAFETY: a handler for a signal that nobody else uses, sent to this very thread.
    unsafe {
        let handler: extern "C" fn(i32) = handler;
        libc::signal(libc::SIGUSR2, handler as libc::sighandler_t);
        libc::raise(libc::SIGUSR2);
    }
    assert_ne!(ENDS.swap(0, Ordering::Relaxed), 0);
}

fn bad_name() -> PortName<'static> {
    // SAFETY: none; whoever reads it faults, which is its purpose.
    let text = unsafe { std::str::from_utf8_unchecked(std::slice::from_raw_parts(without_provenance(64), 100)) };
    PortName { slot: "victim0".into(), port: text.into() }
}

torture! {
    /// Connects ports whose names are not there.
    BadWiringName => || _ = (host::get().links.connect)(bad_name(), bad_name(), &mut Reason::NONE.clone());

    /// Cuts the connections of a port whose name is not there.
    BadUnwiringName => || _ = (host::get().links.disconnect)(bad_name(), &mut Reason::NONE.clone());

    /// Has the reason of a refusal written to where nothing is.
    BadWiringReason => || {
        let name = PortName { slot: "nobody".into(), port: "nothing".into() };
        // SAFETY: none; whoever writes to it faults, which is its purpose.
        let reason: &mut Reason = unsafe { &mut *without_provenance_mut(64) };
        let _ = (host::get().links.connect)(name, name, reason);
    };
}

/// Defines component classes with a client and a server port that strike by the function given.
macro_rules! with_ports {
    ($($(#[$doc:meta])* $class:ident => $strike:expr;)+) => {$(
        $(#[$doc])*
        #[derive(Component)]
        #[component(version = "1.0", periodic = "1ms")]
        pub struct $class {
            #[port]
            ask: QueryClient<Beat, Beat>,
            #[port(handler = on_ask)]
            tell: QueryServer<Beat, Beat>,
            /// Good cycles before the strike.
            #[property(default = 5)]
            after: u64,
            /// Strikes of this class in a process.
            #[property(default = 1000000000)]
            limit: u64,
            cycles: u64,
        }

        impl $class {
            fn on_ask(&mut self, _: &mut Context<'_>, query: Query<'_, Beat, Beat>) -> Outcome {
                query.answer(Beat::default())?;
                Ok(())
            }
        }

        impl Callbacks for $class {
            fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
                static STRIKES: crate::Strikes = crate::Strikes::new();
                self.cycles += 1;
                if self.cycles > self.after {
                    self.cycles = 0;
                    if STRIKES.take(self.limit, cx) {
                        ($strike)([handle(&self.ask), handle(&self.tell)]);
                    }
                }
                Ok(())
            }
        }
    )+};
}

with_ports! {
    /// Calls with handles that nobody gave out, or gave to others.
    ForgedHandles => handles_that_are_none;

    /// Calls with numbers that nobody gave out.
    ForgedNumbers => numbers_that_are_none;

    /// Asks at its server port, answers at its client port.
    CallsOfTheOtherSide => of_the_other_side;

    /// Calls from a thread of its own.
    CallsOnThread => on_a_thread;

    /// Asks, and sleeps, in a signal handler.
    CallsInSignalHandler => in_a_signal_handler;
}

fn handle<T>(port: &T) -> PortHandle {
    const { assert!(size_of::<T>() == size_of::<PortHandle>()) };
    // SAFETY: a port end is its handle and nothing else.
    unsafe { std::mem::transmute_copy(port) }
}
