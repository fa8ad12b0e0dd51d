//! `port::block` for the checker: memory for one number, which reports whoever touches it while another one does.

use component_sdk::object::TypeDescriptor;
use loom::cell::UnsafeCell;

use crate::shared::{AtomicBool, Ordering};

/// Memory for one number.
pub struct Block {
    number: UnsafeCell<u64>,
    filled: AtomicBool,
}

#[allow(unsafe_code, reason = "what is tested is that nobody else touches it")]
// SAFETY: the words of a call order the accesses, which is what is tested.
unsafe impl Sync for Block {}
#[allow(unsafe_code, reason = "as above")]
// SAFETY: as above.
unsafe impl Send for Block {}

impl Block {
    /// An empty one.
    #[must_use]
    pub fn new(_: &'static TypeDescriptor) -> Self {
        Self { number: UnsafeCell::new(0), filled: AtomicBool::new(false) }
    }

    /// The number's cell, as a pointer like any other.
    pub const fn value(&self) -> *mut u8 {
        (&raw const self.number).cast_mut().cast()
    }

    /// True when there is one.
    pub fn is_filled(&self) -> bool {
        self.filled.load(Ordering::Relaxed)
    }

    pub(super) fn forget_contents(&self) {
        self.filled.store(false, Ordering::Relaxed);
    }

    pub(super) fn fill(&self, _: u64) {
        self.filled.store(true, Ordering::Relaxed);
    }
}
