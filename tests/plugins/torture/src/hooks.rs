//! Faults in every callback but `on_execute`.
//!
//! Callbacks of a recovery are reached by a bait: a panic leads to `on_error` and `reset` of the same instance, a trap to
//! constructor, `initialize`, `rehearse`, `recover` and `start` of its successors. Each bait makes one fault in the callback due; `stop`,
//! `destroy` and the drop fault whenever they come, which is when the slot is removed.

use std::sync::atomic::{AtomicU64, Ordering};

use component_sdk::prelude::*;

use super::memory::write;

fn fail(how: &str) {
    match how {
        "panic" => panic!("torture in a callback"),
        _ => write(40),
    }
}

/// Baits that were taken and not yet followed by their fault.
struct Due(AtomicU64);

impl Due {
    const fn new() -> Self {
        Self(AtomicU64::new(0))
    }

    fn add(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }

    fn take(&self) -> bool {
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |due| due.checked_sub(1)).is_ok()
    }
}

/// Defines a component class that faults in one callback, after a bait of that kind.
macro_rules! in_hook {
    ($($(#[$doc:meta])* $class:ident, $bait:literal, fn $hook:ident($($argument:ty),*);)+) => {$(
        $(#[$doc])*
        #[derive(Component)]
        #[component(version = "1.0", periodic = "1ms")]
        pub struct $class {
            /// `segv` or `panic`.
            #[property(default = "segv")]
            how: String,
            /// Good cycles before the bait.
            #[property(default = 5)]
            after: u64,
            /// Strikes of this class in a process.
            #[property(default = 1000000000)]
            limit: u64,
            cycles: u64,
        }

        const _: () = {
            static DUE: Due = Due::new();
            static STRIKES: crate::Strikes = crate::Strikes::new();

            impl Callbacks for $class {
                fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
                    self.cycles += 1;
                    if self.cycles > self.after && STRIKES.take(self.limit, cx) {
                        self.cycles = 0;
                        DUE.add();
                        fail($bait);
                    }
                    Ok(())
                }

                fn $hook(&mut self, $(_: $argument),*) -> Outcome {
                    if DUE.take() {
                        fail(&self.how);
                    }
                    Ok(())
                }
            }
        };
    )+};
}

in_hook! {
    /// Faults in `initialize` of a successor.
    InInitialize, "segv", fn initialize(&mut Context<'_>);

    /// Faults in `start` of a successor.
    InStart, "segv", fn start(&mut Context<'_>);

    /// Faults in `rehearse` of a standby.
    InRehearse, "segv", fn rehearse(&mut Context<'_>);

    /// Faults in `recover`.
    InRecover, "segv", fn recover(&mut Context<'_>, &FaultInfo<'_>);

    /// Faults in `on_error`.
    InOnError, "panic", fn on_error(&mut Context<'_>, &FaultInfo<'_>);

    /// Faults in `reset`.
    InReset, "panic", fn reset(&mut Context<'_>);
}

/// Faults in the constructor of a successor.
#[derive(Component)]
#[component(version = "1.0", periodic = "1ms")]
pub struct InConstructor {
    /// `segv` or `panic`; the constructor reads what the bait left.
    #[property(default = "segv")]
    how: String,
    /// Good cycles before the bait.
    #[property(default = 5)]
    after: u64,
    /// Strikes of this class in a process.
    #[property(default = 1000000000)]
    limit: u64,
    #[allow(dead_code, reason = "its constructor is what matters")]
    part: Part,
    cycles: u64,
}

static PART_DUE: Due = Due::new();
static PART_PANICS: AtomicU64 = AtomicU64::new(0);

struct Part;

impl Default for Part {
    fn default() -> Self {
        if PART_DUE.take() {
            fail(if PART_PANICS.load(Ordering::Relaxed) == 1 { "panic" } else { "segv" });
        }
        Self
    }
}

impl Callbacks for InConstructor {
    fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
        static STRIKES: crate::Strikes = crate::Strikes::new();
        self.cycles += 1;
        if self.cycles > self.after && STRIKES.take(self.limit, cx) {
            self.cycles = 0;
            PART_PANICS.store(u64::from(self.how == "panic"), Ordering::Relaxed);
            PART_DUE.add();
            fail("segv");
        }
        Ok(())
    }
}

/// Faults in `update`.
#[derive(Component)]
#[component(version = "1.0", periodic = "1ms")]
pub struct InUpdate {
    /// `segv` or `panic`.
    #[property(default = "segv")]
    how: String,
    /// Good cycles before the strike.
    #[property(default = 5)]
    after: u64,
    /// Strikes of this class in a process.
    #[property(default = 1000000000)]
    limit: u64,
    cycles: u64,
}

impl Callbacks for InUpdate {
    fn update(&mut self, cx: &mut Context<'_>) -> Outcome {
        static STRIKES: crate::Strikes = crate::Strikes::new();
        self.cycles += 1;
        if self.cycles > self.after && STRIKES.take(self.limit, cx) {
            self.cycles = 0;
            fail(&self.how);
        }
        Ok(())
    }
}

/// Defines a component class that faults on the way out.
macro_rules! on_the_way_out {
    ($($(#[$doc:meta])* $class:ident, $hook:ident;)+) => {$(
        $(#[$doc])*
        #[derive(Component)]
        #[component(version = "1.0", periodic = "1ms")]
        pub struct $class {
            /// `segv` or `panic`.
            #[property(default = "segv")]
            how: String,
            /// Strikes of this class in a process; 0: none.
            #[property(default = 1000000000)]
            limit: u64,
        }

        impl Callbacks for $class {
            fn $hook(&mut self, cx: &mut Context<'_>) -> Outcome {
                static STRIKES: crate::Strikes = crate::Strikes::new();
                if STRIKES.take(self.limit, cx) {
                    fail(&self.how);
                }
                Ok(())
            }
        }
    )+};
}

on_the_way_out! {
    /// Faults in `stop`.
    InStop, stop;

    /// Faults in `destroy`.
    InDestroy, destroy;
}

/// Faults in its drop.
#[derive(Component)]
#[component(version = "1.0", periodic = "1ms")]
pub struct InDrop {
    /// `segv` or `panic`.
    #[property(default = "segv")]
    how: String,
    /// Strikes of this class in a process; 0: none.
    #[property(default = 1000000000)]
    limit: u64,
}

impl Callbacks for InDrop {}

impl Drop for InDrop {
    fn drop(&mut self) {
        // It cannot be told by the log: a drop is given no context.
        if self.limit > 0 {
            fail(&self.how);
        }
    }
}
