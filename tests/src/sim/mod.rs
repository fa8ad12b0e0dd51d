//! Random interleavings of the communication patterns against a model, on one thread with a time of its own.
//!
//! `history (one life of a small system) -> executors (who runs next) -> script (what a callback does) -> the real ends of
//! ports`, and beside each step the model says what must come of it.
//!
//! Real are the ends in `framework_daemon::port`, their wiring by name, fibers, bells and signals. Played are the executors' loop, the
//! plugins and the recovery, so that the order of everything is drawn by lot and comes again with the same seed. A
//! callback gives its executor's thread up between any two operations, too: then other executors run.
//!
//! In some of the worlds a question whose server shares the executor and is at rest is answered at once, from where it is
//! asked: the handler runs on a fiber within the callback of whoever asked. The lanes are played as well. The model
//! says which questions those are, and the same of their ends as of all others. In some of those worlds the lanes do not look
//! whether others are to be looked at first: then the servers alone see to it that nobody jumps their queues. What is counted says how
//! the questions went: "at once ..." and "set aside ...".

/// Random numbers that come again.
pub(crate) mod dice;

/// What must be.
mod model;

/// What must be of events.
mod naive_events;

/// What must be of pushes.
mod naive_pushes;

/// What callbacks wait for.
mod awaited;

/// What is: slots, bells, time.
mod world;

/// The ends of a slot's ports.
mod ends;

/// The way into a slot's handler from where another one asks.
mod lane;

/// What must be of questions that are answered at once.
mod at_once;

/// What a slot is entered for.
mod serving;

/// What a callback does.
mod script;

/// Questions and messages: the client's side.
mod client;

/// The server's side.
mod server;

/// Events, both sides.
mod events;

/// Values, both sides.
mod pushes;

/// Who runs next.
mod executors;

/// What happens from outside: slots come, go and fail, connections change.
mod outside;

/// Connections of events and values.
mod links;

/// When everything rests.
mod rest;

/// Histories, one after the other.
pub mod history;
