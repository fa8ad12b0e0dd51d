//! Patterns in which one component acts on another and something comes back: a file for each part.
//!
//! `requestor (client's end) -> call (one question, its two blocks) -> provider (server's end) -> call -> requestor`.
//!
//! A message is a call without an answer: the server gives its block back when its handler is done. A queue of blocks
//! between outputs and inputs was the alternative: it would be a third way to find a full queue, to wait for a successor and
//! to tell who stopped.
//!
//! A call has two words, each written by one side only, so that neither needs a lock to see how far the other is. A
//! single word with compare-and-swap was the alternative: six atomic operations a query, for an exclusion that the
//! pattern gives anyhow, because client and server hold a call in turn.

mod activation;

/// Service ports of several methods.
pub mod bundle;

mod call;

/// Questions that are answered at once.
pub mod direct;

/// What goes over a connection.
pub mod objects;

/// The client's end of events.
pub mod event_client;
/// Servers that take what comes in by themselves.
mod pull;

/// The server's end of events.
pub mod event_server;

/// What a client that waits for the next value looks at.
pub mod news;

/// The server's end of a push.
pub mod outlet;

/// The server's end.
pub mod provider;

/// The client's end.
pub mod requestor;

/// The client's end of a push.
pub mod subscriber;

/// Whose turn it is.
pub mod turns;

mod event_tests;
mod locks;
mod messages;
mod push_waits;
mod waits;
