//! The operating system: clock, threads, fibers, traps, wake-ups. Most of the daemon's unsafe code has its address here.

mod arch;

/// The monotonic clock.
pub mod clock;

/// System calls that plugin code makes itself.
pub mod fence;

/// A callback runs on a fiber: it may end by a trap without taking its thread along.
pub mod fiber;

/// Threads that plugins start.
pub mod foreign;

/// Log records of components, written by an ordinary thread.
pub mod log_ring;

/// What plugins see as the C library.
pub mod shield;

/// HUP, TERM, INT as values on a channel.
pub mod signals;

/// Whose machine code an address belongs to.
pub mod text;

/// Threads that may run fibers, and how the operating system schedules them.
pub mod thread;

/// Fatal signals on a fiber end the fiber.
pub mod trap;

/// Waiting for a moment or a wake-up.
pub mod wake;
