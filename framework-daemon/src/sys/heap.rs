//! The C library's heap after a thread was given up inside it: `free` and `realloc` as plugins see them.
//!
//! Each thread allocates from an arena of its own. A thread that is given up may hold its arena's lock for ever; whoever
//! frees or grows a piece of memory from that arena would wait for it: healthy neighbours first, because they allocated on
//! the same thread. So such an arena is marked: what comes from it is not given back any more. The daemon itself has
//! another allocator, and does nothing on the main thread, whose arena is marked with the first (`main.rs`).
//!
//! A piece of memory that is freed twice may look as if it came from the main arena. Such a one is told before the C library
//! takes the lock, so that it costs no thread.
//!
//! An allocator for the plugins that needs no locks was the alternative: it would also do away with the C library's checks,
//! which find many a corrupt heap.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition, and the C library's chunk headers")]

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::trap;
use crate::model::limits::{ARENAS, LOST_THREADS_MAX};

/// Heaps of an arena begin at multiples of this (glibc, 64 bits).
const HEAP_BYTES: usize = 64 << 20;
/// Bit of a chunk's size word: not from the main arena.
const OTHER_ARENA: usize = 4;
/// Bit of a chunk's size word: a mapping of its own.
const MAPPED: usize = 2;
/// What stands for the main arena.
const MAIN_ARENA: usize = 0;
/// More than a thread keeps at hand of what others allocated (glibc's tcache), less than what gets a mapping of its own.
const PROBE_BYTES: usize = 4096;
/// Most arenas that are marked: one for each thread that may be given up.
const MARKS: usize = LOST_THREADS_MAX as usize;

static DEAD: [AtomicUsize; MARKS] = [const { AtomicUsize::new(0) }; MARKS];
static DEAD_COUNT: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    // `const` and without destructor: read by the handler.
    static ARENA: Cell<usize> = const { Cell::new(0) };
}

unsafe extern "C" {
    fn __libc_free(memory: *mut c_void);
    fn __libc_malloc(size: usize) -> *mut c_void;
    fn __libc_realloc(memory: *mut c_void, size: usize) -> *mut c_void;
}

/// Lets every thread have an arena of its own; by default they share eight for each processor.
pub fn install() {
    // SAFETY: a setting, before most threads exist.
    unsafe { libc::mallopt(libc::M_ARENA_MAX, ARENAS) };
}

/// Notes which arena the calling thread allocates from.
pub fn adopt_thread() {
    // SAFETY: what was allocated just now is valid, and freed at once.
    unsafe {
        let probe = __libc_malloc(PROBE_BYTES);
        ARENA.set(arena(probe).unwrap_or(0));
        __libc_free(probe);
    }
}

/// The calling thread is given up: nobody touches its arena any more, nor the main one, whose lock it may hold as well.
/// Async-signal-safe.
pub fn abandon_thread() {
    let own = ARENA.get();
    if own != 0
        && let Some(place) = DEAD.get(DEAD_COUNT.fetch_add(1, Ordering::AcqRel))
    {
        place.store(own, Ordering::Release);
    }
}

/// The arena that a piece of memory came from, 0 for the main one; none: it has a mapping of its own.
///
/// # Safety
/// `memory` must come from the C library's `malloc`.
unsafe fn arena(memory: *mut c_void) -> Option<usize> {
    // SAFETY: the size word lies before the memory of every chunk; the heap's first word names the arena.
    unsafe {
        let size = memory.cast::<usize>().sub(1).read();
        match size & (OTHER_ARENA | MAPPED) {
            OTHER_ARENA => Some(memory.map_addr(|address| address & !(HEAP_BYTES - 1)).cast::<usize>().read()),
            0 => Some(MAIN_ARENA),
            _ => None,
        }
    }
}

/// Ends the component that frees or grows what looks like memory of the main arena and is not: it was freed before. The
/// main arena lies between the program and its break.
fn check_main(memory: *mut c_void) {
    // SAFETY: asks for the break, and changes nothing.
    let end = unsafe { libc::sbrk(0) };
    let inside = (&raw const DEAD_COUNT).addr()..end.addr();
    if !inside.contains(&memory.addr()) {
        trap::raise_check();
    }
}

/// # Safety
/// As [`arena`].
unsafe fn is_abandoned(memory: *mut c_void) -> bool {
    if memory.is_null() {
        return false;
    }
    let count = DEAD_COUNT.load(Ordering::Acquire).min(MARKS);
    // SAFETY: the caller's promise.
    match unsafe { arena(memory) } {
        Some(MAIN_ARENA) => {
            check_main(memory);
            count > 0
        }
        Some(arena) => count > 0 && DEAD[..count].iter().any(|dead| dead.load(Ordering::Acquire) == arena),
        None => false,
    }
}

/// The C library's `free`, but for memory of an arena that nobody may touch.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn free(memory: *mut c_void) {
    // SAFETY: the caller's promise.
    unsafe {
        if !is_abandoned(memory) {
            __libc_free(memory);
        }
    }
}

/// The C library's `realloc`; memory of an arena that nobody may touch is copied and left where it is.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn realloc(memory: *mut c_void, size: usize) -> *mut c_void {
    // SAFETY: the caller's promise; both ranges are as long as the copy, and the new one is nobody else's.
    unsafe {
        if !is_abandoned(memory) {
            return __libc_realloc(memory, size);
        }
        let new = __libc_malloc(size);
        if !new.is_null() {
            let len = size.min(libc::malloc_usable_size(memory));
            std::ptr::copy_nonoverlapping(memory.cast::<u8>(), new.cast::<u8>(), len);
        }
        new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_of_a_thread_that_was_given_up_stays_where_it_is() {
        install();
        let address = std::thread::spawn(|| {
            adopt_thread();
            // SAFETY: plain memory.
            let memory = unsafe { __libc_malloc(100) };
            // SAFETY: as above; 100 bytes are there.
            unsafe { memory.cast::<u8>().write_bytes(7, 100) };
            abandon_thread();
            memory.expose_provenance()
        })
        .join()
        .unwrap();
        let memory = std::ptr::with_exposed_provenance_mut::<c_void>(address);
        // SAFETY: allocated above, and not freed yet.
        unsafe {
            assert!(is_abandoned(memory));
            let grown = realloc(memory, 200);
            assert_ne!(grown, memory);
            assert_eq!((*grown.cast::<u8>(), *memory.cast::<u8>()), (7, 7));
            free(memory);
            assert_eq!(*memory.cast::<u8>(), 7, "nothing wrote into it");
            free(grown);
        }
    }
}
