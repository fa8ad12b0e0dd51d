//! One component for each way in which a plugin can harm its host.
//!
//! Each acts in its `on_execute` after some good cycles, and so does each instance that follows it: a slot faults again and
//! again, until the process has seen `limit` strikes of that class. One strike per way in, so that whoever counts knows how
//! many faults there must be.
#![allow(unsafe_code, reason = "faults on purpose")]

use std::sync::atomic::{AtomicU64, Ordering};

use component_sdk::prelude::*;

/// Defines component classes that strike in `on_execute` by the function given.
macro_rules! torture {
    ($($(#[$doc:meta])* $class:ident => $strike:expr;)+) => {$(
        $(#[$doc])*
        #[derive(component_sdk::prelude::Component)]
        #[component(version = "1.0", periodic = "1ms")]
        pub struct $class {
            /// Good cycles before the strike.
            #[property(default = 5)]
            after: u64,
            /// Strikes of this class in a process.
            #[property(default = 1000000000)]
            limit: u64,
            cycles: u64,
        }

        impl component_sdk::prelude::Callbacks for $class {
            fn on_execute(&mut self, cx: &mut component_sdk::prelude::Context<'_>) -> component_sdk::prelude::Outcome {
                static STRIKES: $crate::Strikes = $crate::Strikes::new();
                self.cycles += 1;
                if self.cycles > self.after {
                    self.cycles = 0;
                    if STRIKES.take(self.limit, cx) {
                        ($strike)();
                    }
                }
                Ok(())
            }
        }
    )+};
}

/// Components that do their work and watch that nobody disturbs it.
pub mod bystander;

/// Bad pointers handed to the host's functions.
pub mod calls;

/// The processor's floating-point control word.
pub mod float;

/// Queries and wiring with what nobody gave out.
pub mod forged;

/// Callbacks that do not return.
pub mod hangs;

/// Faults in every callback but `on_execute`.
pub mod hooks;

/// Instructions that trap.
pub mod instructions;

/// Bad addresses, an exhausted stack, a damaged heap.
pub mod memory;

/// Panics.
pub mod panics;

/// Faults while others wait.
pub mod parked;

/// The end of the process, signal handlers, signal masks.
pub mod process;

/// Threads that a component starts.
pub mod threads;

/// How often a class has struck in this process.
struct Strikes(AtomicU64);

impl Strikes {
    const fn new() -> Self {
        Self(AtomicU64::new(0))
    }

    /// Counts one; false beyond `limit`. The log tells of the last one: some strikes leave no other trace.
    fn take(&self, limit: u64, cx: &Context<'_>) -> bool {
        let update = |count| (count < limit).then_some(count + 1);
        let taken = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, update);
        if taken == Ok(limit.wrapping_sub(1)) {
            info!(cx, "the last strike");
        }
        taken.is_ok()
    }
}

component_sdk::export_components!(
    bystander::Bystander,
    panics::Panic,
    panics::PanicInDrop,
    panics::DoublePanic,
    instructions::DivideByZero,
    instructions::IllegalInstruction,
    instructions::WildJump,
    instructions::NullJump,
    memory::NullRead,
    memory::NullWrite,
    memory::WildWrite,
    memory::CodeWrite,
    memory::MemcpyBadAddress,
    memory::StrlenBadAddress,
    memory::DoubleFree,
    memory::HeapCorruption,
    memory::StackOverflow,
    process::Abort,
    process::Exit,
    process::RustExit,
    process::UnderscoreExit,
    process::QuickExit,
    process::HandlerReset,
    process::SignalMask,
    process::RawExit,
    process::RawHandlerReset,
    process::RawSignalMask,
    process::RawKill,
    hangs::InfiniteLoop,
    hangs::AllocationLoop,
    hangs::OwnDeadlock,
    hangs::SleepForever,
    hangs::BlockingRead,
    threads::NullReadOnThread,
    threads::PanicOnThread,
    threads::StackOverflowOnThread,
    threads::AbortOnThread,
    float::FloatControlThenFault,
    float::FloatControlLeft,
    calls::ForgedLoan,
    calls::ForgedPublish,
    calls::ForgedGiveBack,
    calls::ForgedRead,
    calls::BadLogText,
    calls::BadRaiseText,
    calls::BadDeviceName,
    calls::BadDeviceFound,
    calls::BadErrorText,
    calls::BadPanicText,
    calls::BadCriticalName,
    calls::BadSafeOutput,
    calls::BadCriticalRegion,
    calls::BadPublishValue,
    calls::BadGiveBackValue,
    calls::StackEndWrite,
    forged::BadWiringName,
    forged::BadUnwiringName,
    forged::BadWiringReason,
    forged::ForgedHandles,
    forged::ForgedNumbers,
    forged::CallsOfTheOtherSide,
    forged::CallsOnThread,
    forged::CallsInSignalHandler,
    parked::ParkedSleeper,
    parked::ParkedAsker,
    parked::FaultBeside,
    parked::LostBeside,
    parked::FaultInHandler,
    hooks::InConstructor,
    hooks::InInitialize,
    hooks::InStart,
    hooks::InRehearse,
    hooks::InUpdate,
    hooks::InStop,
    hooks::InDestroy,
    hooks::InDrop,
    hooks::InOnError,
    hooks::InReset,
    hooks::InRecover,
);
