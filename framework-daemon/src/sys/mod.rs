//! The operating system: clock, threads, fibers, traps, wake-ups. Most of the daemon's unsafe code has its address here.

/// All that depends on the processor.
pub mod arch;

/// Threads that carry executors, and those that take over from one that is given up.
pub mod carrier;

/// The monotonic clock.
pub mod clock;

/// What makes an executor look at its members.
pub mod bell;

/// A copy with its checksum, in one pass.
pub mod copy;

/// Tasks, as far as others need to reach them.
pub mod crowd;

/// System calls that plugin code makes itself.
pub mod fence;

/// A callback runs on a fiber: it may end by a trap without taking its thread along.
pub mod fiber;

/// The fibers of one executor.
pub mod fiber_pool;

/// What a handler of a fatal signal saw.
mod seen;

/// Stacks of fibers.
mod stack;

/// What becomes of stacks that are never used again.
pub mod grave;

/// Threads that plugins start.
pub mod foreign;

/// Waiting on a word of memory.
pub mod futex;

/// The C library's heap after a thread was given up.
pub mod heap;

/// The latch of the emergency stop, which outlives the process.
pub mod latch;

/// What the process still says when it dies by a trap.
pub mod last_words;

/// Functions of the C library that hold no lock.
pub mod leaf;

/// Log records of components, written by an ordinary thread.
pub mod log_ring;

/// Waiting without sleep, where that was worth it lately.
pub mod lookout;

/// Memory that may not be there.
pub mod peek;

/// Where the files of a run lie.
pub mod place;

/// A part of a file as memory.
pub mod mapping;

/// Pages that stay in memory.
pub mod memory;

/// Until when a callback must have returned.
pub mod pulse;

/// From a thread that is given up to one in reserve.
pub mod relay;

/// What is written to actuators when the process dies.
pub mod safe_outputs;

/// Whose code runs on a thread.
pub mod seat;

/// Atomics, locks and queues, by names that a model checker can take.
pub mod shared;

/// What plugins see as the C library.
pub mod shield;

/// HUP, TERM, INT, USR1 as values on a channel.
pub mod signals;

/// Whether standard output was there when the process began.
pub mod streams;

/// Whose machine code an address belongs to.
pub mod text;

/// Threads that may run fibers, and how the operating system schedules them.
pub mod thread;

/// Fatal signals on a fiber end the fiber.
pub mod trap;

/// Sees which callback is over its deadline.
pub mod watchdog;

/// Waiting for a moment or a wake-up.
pub mod wake;
