//! Stacks of fibers.
//!
//! Each has the pages of page tables that map it for itself. A grave that shares one with its neighbours would keep it for
//! ever: two kilobytes for each fiber that was ended, a gigabyte after half a million.
#![allow(unsafe_code, reason = "address of unsafe: mappings")]

use std::io;
use std::ops::Range;
use std::ptr::without_provenance_mut;

use corosensei::stack::{MIN_STACK_SIZE, Stack, StackPointer};

/// What one page of page tables maps (pages of 4 KiB; where they are larger, graves share, and cost what they cost).
const TABLE_BYTES: usize = 2 << 20;

/// Addresses that nothing lies behind.
pub(super) const RESERVED: i32 = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE;

/// A stack with a guard below it, in a range of addresses that it shares with nothing.
pub(super) struct OwnStack {
    range: Range<usize>,
    limit: usize,
}

impl OwnStack {
    /// A stack of about that size.
    ///
    /// # Errors
    /// When the system has no address space left.
    pub(super) fn new(bytes: usize) -> io::Result<Self> {
        let page = page_bytes();
        let used = bytes.max(MIN_STACK_SIZE).next_multiple_of(page);
        let range = reserve((used + page).next_multiple_of(TABLE_BYTES))?;
        let stack = Self { limit: range.end - used - page, range };
        let start = without_provenance_mut(stack.limit + page);
        // SAFETY: inside the range, which is ours and used by nobody yet.
        match unsafe { libc::mprotect(start, used, libc::PROT_READ | libc::PROT_WRITE) } {
            0 => Ok(stack),
            _ => Err(io::Error::last_os_error()),
        }
    }

    /// All its addresses, for [`super::grave::entomb`].
    pub(super) fn range(&self) -> Range<usize> {
        self.range.clone()
    }
}

impl Drop for OwnStack {
    fn drop(&mut self) {
        // SAFETY: the range is ours, and whoever ran on it is gone.
        unsafe { libc::munmap(without_provenance_mut(self.range.start), self.range.len()) };
    }
}

// SAFETY: base and limit are those of one mapping, both aligned to a page, which lives as long as the stack; below the limit's
// page, which is a guard, nothing is accessible.
unsafe impl Stack for OwnStack {
    fn base(&self) -> StackPointer {
        StackPointer::new(self.range.end).expect("a mapping does not end at address 0")
    }

    fn limit(&self) -> StackPointer {
        StackPointer::new(self.limit).expect("a mapping does not begin at address 0")
    }
}

/// Inaccessible addresses, as many as that, which begin and end where a page of page tables does.
fn reserve(len: usize) -> io::Result<Range<usize>> {
    let whole = len + TABLE_BYTES;
    // SAFETY: a new mapping, wherever the system likes; what is cut off of it is not used yet.
    unsafe {
        let mapped = libc::mmap(std::ptr::null_mut(), whole, libc::PROT_NONE, RESERVED, -1, 0);
        if mapped == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        // The upper end is kept: the next mapping lies below, and graves side by side are one.
        let end = (mapped.addr() + whole) / TABLE_BYTES * TABLE_BYTES;
        cut(end..mapped.addr() + whole);
        cut(mapped.addr()..end - len);
        Ok(end - len..end)
    }
}

/// # Safety
/// The range must be mapped and used by nobody.
unsafe fn cut(range: Range<usize>) {
    if !range.is_empty() {
        // SAFETY: the caller's promise.
        unsafe { libc::munmap(without_provenance_mut(range.start), range.len()) };
    }
}

fn page_bytes() -> usize {
    // SAFETY: asks, and changes nothing.
    usize::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).unwrap_or(4096)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stack_has_its_page_tables_for_itself() {
        for bytes in [1, 64 << 10, 1 << 20, 2 << 20, 5 << 20] {
            let stack = OwnStack::new(bytes).unwrap();
            let range = stack.range();
            assert!(range.start.is_multiple_of(TABLE_BYTES) && range.end.is_multiple_of(TABLE_BYTES));
            assert!(stack.base().get() - stack.limit().get() > bytes && stack.limit().get() >= range.start);
            // SAFETY: above its guard the stack is ours to write.
            unsafe { without_provenance_mut::<u8>(stack.limit().get() + page_bytes()).write_volatile(1) };
        }
    }
}
