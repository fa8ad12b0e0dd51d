//! A growable array of fixed layout that carries its own deallocator, so that whoever drops it frees it rightly.
#![allow(unsafe_code, reason = "address of unsafe: a vector of our own, for its layout is contract")]

use std::alloc::{Layout, alloc, dealloc, handle_alloc_error};
use std::fmt;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;

use super::descriptor::{CommObject, Kind, TypeDescriptor};

/// Frees memory of that size and alignment.
type Free = extern "C" fn(memory: *mut u8, size: usize, align: usize);

/// Any number of elements. Behaves as a `Vec`; cleared, it keeps its memory.
#[repr(C)]
pub struct Sequence<T> {
    start: NonNull<T>,
    len: usize,
    capacity: usize,
    free: Free,
}

// SAFETY: a `Sequence` owns its elements as a `Vec` does; `free` is a plain function.
unsafe impl<T: Send> Send for Sequence<T> {}
// SAFETY: as above: shared access gives shared access to the elements only.
unsafe impl<T: Sync> Sync for Sequence<T> {}

extern "C" fn free_here(memory: *mut u8, size: usize, align: usize) {
    if let Ok(layout) = Layout::from_size_align(size, align)
        && size != 0
    {
        // SAFETY: only memory of this module's allocator, of this layout, is paired with this function.
        unsafe { dealloc(memory, layout) };
    }
}

impl<T> Sequence<T> {
    /// An empty one; allocates nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self { start: NonNull::dangling(), len: 0, capacity: 0, free: free_here }
    }

    /// How many elements fit without allocating.
    #[must_use]
    pub const fn capacity(&self) -> usize {
        self.capacity
    }

    /// Makes room for `more` elements beyond those that are there.
    pub fn reserve(&mut self, more: usize) {
        let wanted = self.len.checked_add(more).expect("capacity overflow");
        if wanted > self.capacity {
            self.move_to(wanted.max(self.capacity * 2).max(4));
        }
    }

    fn move_to(&mut self, capacity: usize) {
        let layout = Layout::array::<T>(capacity).expect("capacity overflow");
        let start = if layout.size() == 0 {
            NonNull::dangling()
        } else {
            // SAFETY: the layout's size is not zero.
            let memory = unsafe { alloc(layout) };
            NonNull::new(memory.cast::<T>()).unwrap_or_else(|| handle_alloc_error(layout))
        };
        // SAFETY: `len <= capacity` elements lie at the old start, the new memory is apart from it and large enough;
        // moved out, the old ones are not dropped, only their memory is freed.
        unsafe { start.copy_from_nonoverlapping(self.start, self.len) };
        self.release();
        (self.start, self.capacity, self.free) = (start, capacity, free_here);
    }

    fn release(&mut self) {
        let size = self.capacity * size_of::<T>();
        if size != 0 {
            (self.free)(self.start.as_ptr().cast(), size, align_of::<T>());
        }
    }

    /// Adds an element at the end.
    pub fn push(&mut self, element: T) {
        self.reserve(1);
        // SAFETY: `reserve` made room for one more.
        unsafe { self.start.add(self.len).write(element) };
        self.len += 1;
    }

    /// Drops all elements; keeps the memory.
    pub fn clear(&mut self) {
        self.truncate(0);
    }

    /// Drops all but the first `len` elements.
    pub fn truncate(&mut self, len: usize) {
        if len < self.len {
            let tail = std::ptr::slice_from_raw_parts_mut(self.start.as_ptr().wrapping_add(len), self.len - len);
            self.len = len;
            // SAFETY: the tail's elements are initialised and, `len` being lowered first, dropped only here.
            unsafe { tail.drop_in_place() };
        }
    }
}

impl<T: Clone> Sequence<T> {
    /// Cuts or fills up with `element`.
    pub fn resize(&mut self, len: usize, element: T) {
        self.truncate(len);
        self.reserve(len - self.len);
        while self.len < len {
            self.push(element.clone());
        }
    }

    /// Adds copies of `elements` at the end.
    pub fn extend_from_slice(&mut self, elements: &[T]) {
        self.reserve(elements.len());
        for element in elements {
            self.push(element.clone());
        }
    }
}

impl<T: Copy> Sequence<T> {
    /// Replaces all elements by copies of `elements`, in one move of memory.
    pub fn assign(&mut self, elements: &[T]) {
        self.clear();
        self.reserve(elements.len());
        // SAFETY: `reserve` made room for them, in memory that a borrowed slice cannot overlap; they are `Copy`.
        unsafe { self.start.copy_from_nonoverlapping(NonNull::from(elements).cast(), elements.len()) };
        self.len = elements.len();
    }
}

impl<T> Drop for Sequence<T> {
    fn drop(&mut self) {
        self.clear();
        self.release();
    }
}

impl<T> Default for Sequence<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T> Deref for Sequence<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        // SAFETY: `len` initialised elements lie at `start`, which is aligned and not null even when empty.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }
}

impl<T> DerefMut for Sequence<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as in `deref`; `&mut self` makes the access exclusive.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }
}

impl<T> From<Vec<T>> for Sequence<T> {
    /// Takes the vector's memory over; copies nothing.
    fn from(vec: Vec<T>) -> Self {
        let mut vec = std::mem::ManuallyDrop::new(vec);
        let start = NonNull::new(vec.as_mut_ptr()).unwrap_or(NonNull::dangling());
        Self { start, len: vec.len(), capacity: vec.capacity(), free: free_here }
    }
}

impl<T> FromIterator<T> for Sequence<T> {
    fn from_iter<I: IntoIterator<Item = T>>(elements: I) -> Self {
        Vec::from_iter(elements).into()
    }
}

impl<T> Extend<T> for Sequence<T> {
    fn extend<I: IntoIterator<Item = T>>(&mut self, elements: I) {
        elements.into_iter().for_each(|element| self.push(element));
    }
}

impl<'a, T> IntoIterator for &'a Sequence<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;
    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<T: Clone> Clone for Sequence<T> {
    fn clone(&self) -> Self {
        self.to_vec().into()
    }
}

impl<T: PartialEq> PartialEq for Sequence<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: fmt::Debug> fmt::Debug for Sequence<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

// SAFETY: the descriptor names size, alignment and element; `flat` and `path` know this layout by the type itself.
unsafe impl<T: CommObject> CommObject for Sequence<T> {
    const DESCRIPTOR: &'static TypeDescriptor = &TypeDescriptor::of_elements(
        "sequence",
        Kind::Sequence,
        size_of::<Self>(),
        align_of::<Self>(),
        0,
        T::DESCRIPTOR,
    );

    fn empty() -> Self {
        Self::new()
    }
}

/// A sequence of unknown element type: what `flat` and `path` see. Same layout as every [`Sequence`].
#[repr(C)]
pub(super) struct RawSequence {
    pub(super) start: *mut u8,
    pub(super) len: usize,
    pub(super) capacity: usize,
    pub(super) free: Free,
}

impl RawSequence {
    /// Memory for `len` elements, contents not yet written.
    pub(super) fn with_room(len: usize, element: &TypeDescriptor) -> Self {
        let size = len.checked_mul(element.size).expect("lengths were checked against the input");
        let layout = Layout::from_size_align(size, element.align).expect("a descriptor's alignment is a compiler's");
        let start = if size == 0 {
            std::ptr::without_provenance_mut(element.align)
        } else {
            // SAFETY: the layout's size is not zero.
            let memory = unsafe { alloc(layout) };
            if memory.is_null() { handle_alloc_error(layout) } else { memory }
        };
        Self { start, len, capacity: len, free: free_here }
    }
}

const _: () = assert!(size_of::<RawSequence>() == size_of::<Sequence<u8>>());

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_behaves_as_a_vec() {
        let mut sequence = Sequence::new();
        let mut vec = Vec::new();
        for i in 0..100 {
            sequence.push(format!("{i}"));
            vec.push(format!("{i}"));
        }
        sequence.truncate(40);
        vec.truncate(40);
        sequence.resize(50, "x".into());
        vec.resize(50, "x".into());
        assert_eq!(&*sequence, &*vec);
    }

    #[test]
    fn assigning_replaces_what_was_there() {
        let mut sequence = Sequence::from(vec![9u16; 3]);
        sequence.assign(&[1, 2, 3, 4, 5]);
        assert_eq!(&*sequence, [1, 2, 3, 4, 5]);
        sequence.assign(&[]);
        assert!(sequence.is_empty());
    }

    #[test]
    fn a_cleared_one_keeps_its_memory() {
        let mut sequence = Sequence::from(vec![0u8; 1000]);
        let start = sequence.as_ptr();
        sequence.clear();
        sequence.resize(1000, 1);
        assert_eq!(sequence.as_ptr(), start);
    }
}
