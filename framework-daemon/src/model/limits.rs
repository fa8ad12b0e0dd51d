//! Every bound, in one place, units in the names.

/// Address space of a fiber's stack where the profile says nothing; only touched pages take memory.
pub const STACK_BYTES: usize = 1 << 20;
/// Smallest stack that a profile may ask for.
pub const STACK_MIN_BYTES: usize = 16 << 10;
/// Largest stack that a profile may ask for.
pub const STACK_MAX_BYTES: usize = 1 << 30;
/// Alternate signal stack of each guarded thread; AVX-512 frames are large.
pub const SIGNAL_STACK_BYTES: usize = 64 << 10;
/// Most resets that one restart intensity may allow: size of the history kept for each slot.
pub const RESETS_MAX: usize = 64;
/// Longest panic message, error text or log record kept, in bytes.
pub const TEXT_BYTES: usize = 400;
/// Log records of components waiting to be written.
pub const LOG_RECORDS: usize = 1024;
/// Fault events waiting for the fault manager.
pub const FAULT_EVENTS: usize = 4096;
/// Idle fibers kept by an executor for each size of stack.
pub const IDLE_FIBERS: usize = 4;
/// Most values that one FIFO may hold.
pub const FIFO_VALUES_MAX: usize = 1 << 16;
/// Blocks of an output port beyond those that its readers can hold.
pub const SPARE_BLOCKS: usize = 2;
/// Longest time that `stop` and `destroy` of one component may take at shutdown.
pub const SHUTDOWN_STEP_MS: u64 = 500;
/// Recoveries tried for one fault before the slot is stopped.
pub const RECOVERY_STEPS_MAX: usize = 16;

const _: () = assert!(STACK_MIN_BYTES <= STACK_BYTES && STACK_BYTES <= STACK_MAX_BYTES);
const _: () = assert!(TEXT_BYTES >= component_sdk::context::TEXT_LIMIT);
