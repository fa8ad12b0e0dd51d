//! All that depends on the processor: one small file each, with the same functions.
//!
//! x86-64 is proven by the tests. The functions for aarch64 are compiled and read, not run: what they rest on is the
//! architecture's register names in the signal frame and `corosensei`'s own trap handler, which its authors test there.

#[cfg(target_arch = "aarch64")]
mod aarch64;
#[cfg(target_arch = "x86_64")]
mod x86_64;

#[cfg(target_arch = "aarch64")]
pub use aarch64::{continue_at, end_thread, position, redirect, return_address, strike, waits};
#[cfg(target_arch = "x86_64")]
pub use x86_64::{continue_at, end_thread, position, redirect, return_address, strike, waits};
