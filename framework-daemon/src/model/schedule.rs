//! How the operating system is to schedule a thread.

use serde::Serialize;

/// Policy, priority and affinity.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Schedule {
    /// Scheduling policy.
    pub policy: Policy,
    /// Real-time priority, 1 to 99; without meaning for [`Policy::Other`].
    pub priority: i32,
    /// Processors that the thread may use; empty: all.
    pub cpus: Vec<usize>,
}

/// Scheduling policy of a thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Policy {
    /// `SCHED_OTHER`: time sharing.
    #[default]
    Other,
    /// `SCHED_FIFO`: real time, until it blocks.
    Fifo,
    /// `SCHED_RR`: real time, in turns.
    RoundRobin,
}
