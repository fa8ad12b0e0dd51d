//! Fault path, step 2: `event -> symbols -> journal -> feed -> log -> ledger -> diagnose -> decide -> handle`. What the slot
//! itself needed was done by the executor that saw the fault ([`crate::exec::recover`]); here it is written down and told, and
//! what follows for others is found out and done.

/// Who is stopped and started, in which order; pure.
pub mod decide;

/// Who may run, who is held and why, whose consequence a fault is; pure.
pub mod diagnose;

/// The newest lines, for whoever lists or follows them.
pub mod feed;

/// Who needs whom, compiled from the plan.
pub mod graph;

/// Carries decisions out, by executors' commands.
pub mod handle;

/// Append-only JSON lines with checksums.
pub mod journal;

/// Sees to the file of the emergency stop's latch.
pub mod latchkeeper;

/// What faults cost for good, against its bounds.
pub mod ledger;

/// The loop: take an event, write it down, tell it, handle it.
pub mod manager;

/// What an operator orders.
pub mod order;

/// The fault manager's ports: what components hear of faults, and report.
pub mod ports;

/// What follows where too few members of a voter agree.
pub mod quorum;

/// Which raises of the emergency stop an operator can know of; pure.
pub mod raises;

/// How all slots are, and what follows; pure.
pub mod situation;

/// What models and voters found, in words.
pub mod words;
