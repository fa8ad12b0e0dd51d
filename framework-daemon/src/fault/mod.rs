//! Fault path, step 2: `event -> symbols -> journal -> feed -> log -> ledger`. What had to be done was done by the executor that saw the fault
//! ([`crate::exec::recover`]); here it is written down and told.

/// The newest lines, for whoever lists or follows them.
pub mod feed;

/// Append-only JSON lines with checksums.
pub mod journal;

/// What faults cost for good, against its bounds.
pub mod ledger;

/// The loop: take an event, write it down, tell it.
pub mod manager;
