//! All that depends on the processor, one small file each.

#[cfg(target_arch = "aarch64")]
mod aarch64;
#[cfg(target_arch = "x86_64")]
mod x86_64;

#[cfg(target_arch = "aarch64")]
pub(super) use aarch64::{link, registers};
#[cfg(target_arch = "x86_64")]
pub(super) use x86_64::{link, registers};
