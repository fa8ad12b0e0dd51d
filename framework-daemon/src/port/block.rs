//! Blocks: memory that carries one object, shared by count among its readers.
//!
//! An output port owns its blocks and lends out those that no reader holds any more, with their old contents: a
//! 1 MiB frame is neither copied nor allocated anew. A free list fed by the readers was the alternative: it makes every
//! reader touch the writer's memory.
#![allow(unsafe_code, reason = "address of unsafe: memory whose type only plugins know")]

use std::alloc::{Layout, alloc_zeroed, dealloc, handle_alloc_error};
use std::ptr::NonNull;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU64, Ordering};

use component_sdk::object::{TypeDescriptor, flat};

/// An object on its way. Immutable from `publish` until its last holder drops it.
pub type Sample = Arc<Block>;

/// Memory for one object of a described type.
#[derive(Debug)]
pub struct Block {
    object: &'static TypeDescriptor,
    memory: NonNull<u8>,
    filled: AtomicBool,
    stamp_ns: AtomicU64,
}

// SAFETY: the object inside is `Send + Sync` (supertraits of `CommObject`); it is written only by the one borrower of a
// block that nobody else holds, and published through a queue that orders the accesses.
unsafe impl Send for Block {}
// SAFETY: as above.
unsafe impl Sync for Block {}

impl Block {
    /// An empty block.
    #[must_use]
    pub fn new(object: &'static TypeDescriptor) -> Self {
        let layout = layout(object);
        // SAFETY: the layout's size is not zero.
        let memory = unsafe { alloc_zeroed(layout) };
        let memory = NonNull::new(memory).unwrap_or_else(|| handle_alloc_error(layout));
        Self { object, memory, filled: AtomicBool::new(false), stamp_ns: AtomicU64::new(0) }
    }

    /// Where the object lies.
    #[must_use]
    pub const fn value(&self) -> *mut u8 {
        self.memory.as_ptr()
    }

    /// Its type.
    #[must_use]
    pub const fn object(&self) -> &'static TypeDescriptor {
        self.object
    }

    /// True when an object lies in it.
    #[must_use]
    pub fn is_filled(&self) -> bool {
        self.filled.load(Ordering::Relaxed)
    }

    /// When the object was written.
    #[must_use]
    pub fn stamp_ns(&self) -> u64 {
        self.stamp_ns.load(Ordering::Relaxed)
    }

    /// What lies in it may be half an object, which nobody may drop: what that owns is lost, the memory is used again.
    pub(super) fn forget_contents(&self) {
        self.filled.store(false, Ordering::Relaxed);
    }

    /// Says that an object lies in it since `now_ns`.
    pub(super) fn fill(&self, now_ns: u64) {
        self.stamp_ns.store(now_ns, Ordering::Relaxed);
        self.filled.store(true, Ordering::Relaxed);
    }
}

impl Drop for Block {
    fn drop(&mut self) {
        // SAFETY: a filled block holds a valid object of its description, and nobody else holds the block. The memory
        // came from `new` with this layout.
        unsafe {
            if *self.filled.get_mut() {
                flat::drop_raw(self.object, self.memory.as_ptr());
            }
            dealloc(self.memory.as_ptr(), layout(self.object));
        }
    }
}

/// At most one sample, handed on by one exchange.
#[derive(Debug, Default)]
pub(super) struct Newest(AtomicPtr<Block>);

impl Newest {
    /// Puts one in; what was there before.
    #[inline]
    pub(super) fn put(&self, sample: Sample) -> Option<Sample> {
        let before = self.0.swap(Arc::into_raw(sample).cast_mut(), Ordering::AcqRel);
        // SAFETY: every address in here came from a sample that was given up to it, and an exchange takes it out once.
        (!before.is_null()).then(|| unsafe { Arc::from_raw(before) })
    }

    /// Puts one in; what was there before. Without an atomic exchange, which would take longer than all else.
    ///
    /// # Safety
    /// Nobody else may put one in, take it out or look at it meanwhile.
    #[inline]
    pub(super) unsafe fn put_alone(&self, sample: Sample) -> Option<Sample> {
        let before = self.0.load(Ordering::Acquire);
        self.0.store(Arc::into_raw(sample).cast_mut(), Ordering::Release);
        // SAFETY: as above; alone, by the caller's promise, this thread takes it out once.
        (!before.is_null()).then(|| unsafe { Arc::from_raw(before) })
    }

    /// Takes it out.
    #[inline]
    pub(super) fn take(&self) -> Option<Sample> {
        if self.is_empty() {
            return None;
        }
        let before = self.0.swap(std::ptr::null_mut(), Ordering::AcqRel);
        // SAFETY: as above.
        (!before.is_null()).then(|| unsafe { Arc::from_raw(before) })
    }

    /// Looks at it.
    ///
    /// # Safety
    /// Nobody may put one in or take it out meanwhile.
    #[inline]
    pub(super) unsafe fn look(&self) -> Option<&Block> {
        // SAFETY: a sample that stays where it is, by the caller's promise.
        unsafe { self.0.load(Ordering::Acquire).as_ref() }
    }

    /// True when nothing is in it.
    #[inline]
    pub(super) fn is_empty(&self) -> bool {
        self.0.load(Ordering::Relaxed).is_null()
    }
}

impl Drop for Newest {
    fn drop(&mut self) {
        drop(self.take());
    }
}

fn layout(object: &TypeDescriptor) -> Layout {
    Layout::from_size_align(object.size.max(1), object.align).expect("sizes and alignments are a compiler's")
}
