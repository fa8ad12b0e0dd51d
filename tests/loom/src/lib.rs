//! The daemon's own sources of the hand-over, compiled against the model checker's atomics instead of the real ones.
//!
//! A configuration of the whole daemon for the checker was the alternative; its dependencies know that configuration, too,
//! and change with it.

// Not for the unit tests of this crate: those in the sources belong to the daemon, where the atomics are real.

/// Waiting on a word, as the checker sees it.
pub mod futex;

/// From a thread that is given up to one in reserve.
#[cfg(not(test))]
#[path = "../../../framework-daemon/src/sys/relay.rs"]
pub mod relay;

/// Waiting for a wake-up.
#[cfg(not(test))]
#[path = "../../../framework-daemon/src/sys/wake.rs"]
pub mod wake;

/// Where the sources look for what is the checker's.
pub mod sys {
    #[cfg(not(test))]
    pub use super::bell;
    pub use super::{futex, shared};
}

/// Atomics, locks and queues, as the checker sees them.
pub mod shared;

/// Ringing, as the checker sees it.
#[cfg(not(test))]
pub mod bell;

/// What makes an executor look at its members.
#[cfg(not(test))]
#[path = "../../../framework-daemon/src/sys/bell.rs"]
pub mod real_bell;

/// Tasks of a slot.
pub mod crowd;

/// How an executor waits.
#[cfg(not(test))]
pub mod lookout;

/// Whose thread it is.
pub mod seat;

/// What the sources of calls need to know.
#[cfg(not(test))]
pub mod model;

/// Calls between components.
#[cfg(not(test))]
pub mod port;

/// A value that is read all the time and changed now and then.
#[cfg(not(test))]
#[path = "../../../framework-daemon/src/port/exchange.rs"]
pub mod exchange;
