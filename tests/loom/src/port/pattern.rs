//! Client, call, server.

#[path = "../../../../framework-daemon/src/port/pattern/call.rs"]
mod call;

/// Questions that are answered at once.
#[path = "../../../../framework-daemon/src/port/pattern/direct.rs"]
pub mod direct;

/// What goes over a connection.
#[path = "../../../../framework-daemon/src/port/pattern/objects.rs"]
pub mod objects;

/// The server's end.
#[path = "../../../../framework-daemon/src/port/pattern/turns.rs"]
pub mod turns;

#[path = "../../../../framework-daemon/src/port/pattern/provider.rs"]
pub mod provider;

/// The client's end.
#[path = "../../../../framework-daemon/src/port/pattern/requestor.rs"]
pub mod requestor;

/// What a client that waits for the next value looks at.
#[path = "../../../../framework-daemon/src/port/pattern/news.rs"]
pub mod news;
