//! Bad addresses, an exhausted stack, a damaged heap.

use std::hint::black_box;
use std::ptr::without_provenance_mut;

torture! {
    /// Reads the null page.
    NullRead => || _ = black_box(read(16));

    /// Writes to the null page.
    NullWrite => || write(24);

    /// Writes to an address that no process has.
    WildWrite => || write(0x7dea_dbee_f000);

    /// Writes to its own code.
    CodeWrite => || write(write as fn(usize) as usize);

    /// Copies to a bad address: the program counter is in the C library.
    MemcpyBadAddress => || copy_to(8);

    /// Measures a text at a bad address.
    StrlenBadAddress => || _ = black_box(length_at(8));

    /// Frees a small block twice: the C library sees it and aborts.
    DoubleFree => double_free;

    /// Writes over the end of a large block, so that the C library sees it with its lock held and aborts.
    HeapCorruption => corrupt_heap;

    /// Recurses without end.
    StackOverflow => || _ = black_box(overflow(1));
}

#[inline(never)]
pub(crate) fn read(address: usize) -> u32 {
    // SAFETY: none; the read faults, which is its purpose.
    unsafe { black_box(without_provenance_mut::<u32>(address)).read_volatile() }
}

#[inline(never)]
pub(crate) fn write(address: usize) {
    // SAFETY: none; the write faults, which is its purpose.
    unsafe { black_box(without_provenance_mut::<u32>(address)).write_volatile(1) };
}

fn copy_to(address: usize) {
    let from = black_box([7u8; 4096]);
    // SAFETY: none; the copy faults, which is its purpose. Its length is unknown to the compiler, so the call stays one.
    unsafe { libc::memcpy(black_box(without_provenance_mut(address)), from.as_ptr().cast(), black_box(from.len())) };
}

fn length_at(address: usize) -> usize {
    // SAFETY: none; the read faults, which is its purpose.
    unsafe { libc::strlen(black_box(without_provenance_mut(address))) }
}

fn double_free() {
    // SAFETY: none; the second `free` is the fault.
    unsafe {
        let block = black_box(libc::malloc(40));
        libc::free(block);
        libc::free(black_box(block));
    }
}

/// The blocks are too large for the allocator's lists of small ones, whose checks take no lock.
pub(crate) fn corrupt_heap() {
    const SIZE: usize = 4096;
    // SAFETY: none; the writes beyond the block are the fault. They hit the head of the next block, which is ours too.
    unsafe {
        let block: *mut u8 = black_box(libc::malloc(SIZE)).cast();
        let next: *mut u8 = black_box(libc::malloc(SIZE)).cast();
        let fence = black_box(libc::malloc(SIZE));
        next.sub(8).cast::<u64>().write_volatile(0x0041_4141_4141_4140);
        libc::free(block.cast());
        libc::free(next.cast());
        libc::free(fence);
    }
}

#[inline(never)]
#[allow(unconditional_recursion, reason = "the stack is to overflow")]
pub(crate) fn overflow(depth: u64) -> u64 {
    let frame = black_box([depth; 64]);
    overflow(depth + 1) + frame[(depth % 64) as usize]
}
