//! What the sources of calls need to know.

/// All limits.
#[path = "../../../framework-daemon/src/model/limits.rs"]
pub mod limits;

/// Time in nanoseconds.
#[path = "../../../framework-daemon/src/model/time.rs"]
pub mod time;
