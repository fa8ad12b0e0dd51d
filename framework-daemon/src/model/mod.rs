//! Plain data that every other module may use. This module knows nobody.

/// One root for a chain of symptoms; pure.
pub mod chain;

/// A fault: symptom, blamed slot, time and evidence, and what was done about it.
pub mod fault;

/// The answer to each symptom, compiled at load; pure.
pub mod ladder;

/// Component states and events, every cell written out.
pub mod lifecycle;

/// Every bound, with the relations between them.
pub mod limits;

/// Interned names.
pub mod names;

/// A processor's registers at a trap.
pub mod registers;

/// How the operating system schedules a thread.
pub mod schedule;

/// What a detector saw, and how severe the integrator says it is.
pub mod symptom;

/// Texts of fixed size.
pub mod text;

/// Durations as nanoseconds.
pub mod time;
