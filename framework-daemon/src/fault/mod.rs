//! Fault path, step 2: `event -> journal -> log`. What had to be done was done by the executor that saw the fault
//! ([`crate::exec::recover`]); here it is written down and told.

/// Append-only JSON lines with checksums.
pub mod journal;

/// The loop: take an event, write it down, tell it.
pub mod manager;
