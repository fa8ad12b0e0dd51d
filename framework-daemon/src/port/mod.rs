//! Data path, first half: `border (a component writes) -> check -> output -> input -> (reader wakes)`.
//!
//! Ports belong to slots. An instance has *bindings* to them, which are closed when it is replaced, so that a thread it
//! left behind reaches nothing.

/// Blocks: memory that carries one object.
pub mod block;

/// Where plugins' port calls arrive: handles become safe calls.
pub mod border;

mod border_calls;

mod border_events;

/// Faults of a slot that somebody else saw.
pub mod charge;

/// What components tell of their devices.
pub mod devices;

/// When values arrive at an input whose silence is a fault.
pub mod hearing;

/// Range checks on the values of a port or connection.
pub mod check;

/// One compiled rule of a check.
mod rule;

/// A value that is read all the time and changed now and then.
pub mod exchange;

/// Output ports and their connections.
pub mod output;

/// Ends of ports that belong to the daemon itself.
pub mod own;

/// Whether a port may wait.
pub mod gate;
/// The blocks of an output port.
mod pool;

/// Input ports: newest or FIFO.
pub mod input;

/// All event ports of a slot.
pub mod event_ends;

/// Event inputs: every event, in order.
pub mod event_in;

/// Patterns in which something comes back.
pub mod pattern;

/// Who listens at an output.
pub mod tap;

/// A model and its target, compared.
pub mod comparer;
/// Redundant outputs, voted over.
pub mod voter;

/// The table behind port handles.
pub mod table;

/// Where plugins' wiring arrives.
mod border_links;

/// Where plugins' subscriptions and cycles arrive.
mod border_pushes;

/// Ports by name.
pub mod registry;
/// Who waits for whom.
pub mod wait;

/// Connections made and cut while everything runs.
pub mod wiring;

/// Those of event ports.
mod wiring_events;

/// The same for service ports of several methods.
mod wiring_services;
