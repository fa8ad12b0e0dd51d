//! Data path, second half: `trigger -> executor -> callback`; and the fault path's answer on the spot: `recover`.
//!
//! What an executor runs belongs to its schedule, not to its thread: members, their instances, standbys and rules are
//! touched by that one thread only and need no lock. Everybody else sends commands. Spares come from the `workshop`, over
//! queues that nobody waits for.

/// The one place where a callback is entered: fiber, injection, outcome.
pub mod callback;

/// A callback that may wait.
pub mod strand;

/// What a successor goes on from.
pub mod checkpoint;

/// The file that checkpoints lie in.
pub mod keep;

/// That file as bytes.
pub mod kept;

/// One schedule: which members, in which order, until told to stop.
pub mod executor;

/// The way into a member's handlers from within others' callbacks.
pub mod lane;

/// A slot as its executor sees it: instance, state, rules, standbys.
pub mod member;

/// Faults on threads that a component started.
pub mod astray;

/// Faults of a slot that somebody else saw.
pub mod charge;

/// Devices that components tell of.
mod device;

/// What a slot that is built anew goes on from.
mod inherit;

/// A consequence waits for what is done about its root.
pub mod follow;

/// Silence at a slot's inputs.
pub mod silence;

/// Instances come and go: constructor and `initialize`, `stop`, `destroy` and the drop.
pub mod prepare;

/// The emergency stop: written, latched, told, in that order.
pub mod emergency;

/// The local answer to a fault: reset, replace or stop, at once.
pub mod recover;

/// Requests of other slots.
mod service;

/// The spare that an executor has at hand.
mod spare;

/// A slot as everybody sees it: name, ports, counters.
pub mod slot;

/// What is done to a slot from outside.
mod steer;

/// Threads of a component: started, ended, answered for.
pub mod task;

/// What tasks did wrong.
mod task_faults;

/// A task's own side.
mod task_run;

/// Data wakes a nonperiodic slot; inline where it is on the same executor.
pub mod trigger;

/// An instance with its bindings, and the recipe for another one.
pub mod unit;

/// A slot goes on from what the run before left.
mod warm;

/// One background thread prepares spares, and clears away what recoveries leave.
pub mod workshop;
