//! What the sources need to know; small, so that the checker gets through.

/// All limits.
pub mod limits {
    use std::time::Duration;

    /// Slots of a plan.
    pub const SLOTS: usize = 2;
    /// Calls of a client port.
    pub const PENDING_MAX: usize = 4;
    /// Calls that wait for a server port.
    pub const INBOX_MAX: usize = 4;
    /// Longest wait.
    pub const DURATION_MAX: Duration = Duration::from_secs(1);
}

/// Time in nanoseconds.
#[path = "../../../framework-daemon/src/model/time.rs"]
pub mod time;
