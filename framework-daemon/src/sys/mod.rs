//! The operating system: clock, threads, fibers, traps, wake-ups. Most of the daemon's unsafe code has its address here.

/// The monotonic clock.
pub mod clock;

/// A callback runs on a fiber: it may end by a trap without taking its thread along.
pub mod fiber;

/// Log records of components, written by an ordinary thread.
pub mod log_ring;

/// Pages that stay in memory.
pub mod memory;

/// The end of the process, as plugins see it.
pub mod shield;

/// HUP, TERM, INT as values on a channel.
pub mod signals;

/// Threads that may run fibers, and how the operating system schedules them.
pub mod thread;

/// Fatal signals on a fiber end the fiber.
pub mod trap;

/// Waiting for a moment or a wake-up.
pub mod wake;
