//! Patterns in which one component acts on another and something comes back: a file for each part.
//!
//! `requestor (client's end) -> call (one question, its two blocks) -> provider (server's end) -> call -> requestor`.
//!
//! A call has two words, each written by one side only, so that neither needs a lock to see how far the other is. A
//! single word with compare-and-swap was the alternative: six atomic operations a query, for an exclusion that the
//! pattern gives anyhow, because client and server hold a call in turn.

mod call;

/// The server's end.
pub mod provider;

/// The client's end.
pub mod requestor;

mod histories;
