//! A processor's registers at a trap: fixed size, filled in the signal handler, names per architecture.

use std::fmt;

use serde::{Serialize, Serializer};

/// General registers and flags, in the order in which they are shown. (Program counter and stack pointer are told apart.)
#[cfg(target_arch = "x86_64")]
pub const NAMES: [&str; 16] =
    ["rax", "rbx", "rcx", "rdx", "rsi", "rdi", "rbp", "r8", "r9", "r10", "r11", "r12", "r13", "r14", "r15", "rflags"];

/// General registers and flags, in the order in which they are shown. (Program counter and stack pointer are told apart.)
#[cfg(target_arch = "aarch64")]
pub const NAMES: [&str; 32] = [
    "x0", "x1", "x2", "x3", "x4", "x5", "x6", "x7", "x8", "x9", "x10", "x11", "x12", "x13", "x14", "x15", "x16", "x17",
    "x18", "x19", "x20", "x21", "x22", "x23", "x24", "x25", "x26", "x27", "x28", "x29", "x30", "pstate",
];

/// Their values.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Registers([u64; NAMES.len()]);

impl Registers {
    /// Nothing is known of them.
    pub const UNKNOWN: Self = Self([0; NAMES.len()]);

    /// Of these values, in the order of [`NAMES`].
    #[must_use]
    pub const fn new(values: [u64; NAMES.len()]) -> Self {
        Self(values)
    }

    /// The value of the register of that name.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<u64> {
        NAMES.iter().position(|known| *known == name).map(|index| self.0[index])
    }

    fn shown(&self) -> impl Iterator<Item = (&'static str, String)> {
        NAMES.into_iter().zip(self.0).map(|(name, value)| (name, format!("{value:#x}")))
    }
}

impl fmt::Debug for Registers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_map().entries(self.shown()).finish()
    }
}

impl Serialize for Registers {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.shown())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn registers_are_shown_by_name_in_hexadecimal() {
        let mut values = [0; NAMES.len()];
        values[1] = 0xff;
        let registers = Registers::new(values);
        assert_eq!(registers.get(NAMES[1]), Some(0xff));
        assert_eq!(serde_json::to_value(registers).unwrap()[NAMES[1]], "0xff");
        assert_eq!(serde_json::to_value(registers).unwrap().as_object().unwrap().len(), NAMES.len());
    }
}
