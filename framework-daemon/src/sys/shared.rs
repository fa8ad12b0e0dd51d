//! What several threads touch: atomics, locks, queues. Named here so that a model checker can put its own in their place
//! (`tests/loom`).

pub use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU8, AtomicU32, AtomicU64, AtomicUsize, Ordering};
pub use std::sync::{Mutex, MutexGuard};

pub use crossbeam_queue::ArrayQueue;
