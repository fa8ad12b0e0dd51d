//! Random interleavings of the communication patterns against a model, on one thread with a time of its own.
//!
//! `history (one life of a small system) -> executors (who runs next) -> script (what a callback does) -> the real ends of
//! ports`, and beside each step the model says what must come of it.
//!
//! Real are the ends in `framework_daemon::port::pattern`, fibers, bells and signals. Played are the executors' loop, the
//! plugins and the recovery, so that the order of everything is drawn by lot and comes again with the same seed. A
//! callback gives its executor's thread up between any two operations, too: then other executors run.

/// Random numbers that come again.
pub(crate) mod dice;

/// What must be.
mod model;

/// What is: ends, bells, time.
mod world;

/// What a callback does.
mod script;

/// A client's operations, and what must come of them.
mod client;

/// A server's.
mod server;

/// Who runs next.
mod executors;

/// What happens from outside: slots come, go and fail, connections change.
mod outside;

/// When everything rests.
mod rest;

/// Histories, one after the other.
pub mod history;
