//! Calls between components.

/// Memory of a call.
pub mod block;

/// Whether a port may wait.
#[path = "../../../../framework-daemon/src/port/gate.rs"]
pub mod gate;

/// Who waits.
pub mod wait;

/// Client, call, server.
#[allow(dead_code, reason = "not all that the daemon uses is checked")]
pub mod pattern;
