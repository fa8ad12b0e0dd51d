//! Functions of the C library that hold no lock and have no frame: a fiber may be ended inside them.
//!
//! A bad pointer handed to `memcpy` is the commonest fault of all. Treating all of the C library as "may hold a lock" would
//! give up a thread for each; so the addresses of these few are looked up once.
#![allow(unsafe_code, reason = "address of unsafe: symbol lookup")]

use std::sync::atomic::{AtomicUsize, Ordering};

/// Their names; what the processor's variant of each is, the C library decides at start.
const NAMES: [&std::ffi::CStr; 26] = [
    c"memcpy",
    c"memmove",
    c"memset",
    c"memcmp",
    c"bcmp",
    c"memchr",
    c"memrchr",
    c"rawmemchr",
    c"mempcpy",
    c"strlen",
    c"strnlen",
    c"strcpy",
    c"stpcpy",
    c"strncpy",
    c"stpncpy",
    c"strcat",
    c"strncat",
    c"strcmp",
    c"strncmp",
    c"strchr",
    c"strchrnul",
    c"strrchr",
    c"wcslen",
    c"wmemset",
    // Not one of them, but as harmless: a raw system call, of a lock of the component's own for example.
    c"syscall",
    c"sched_yield",
];

/// Bytes from an entry that count as its function: the longest variant is shorter, and what follows are more of the kind.
const EXTENT: usize = 2048;

/// The last two are short, and followed by anything.
const EXTENT_SHORT: usize = 48;

static ENTRIES: [AtomicUsize; NAMES.len()] = [const { AtomicUsize::new(0) }; NAMES.len()];

/// Looks them up; once, before anything traps.
pub fn install() {
    for (entry, name) in ENTRIES.iter().zip(NAMES) {
        // SAFETY: the name is a C string; what is found is only compared.
        let found = unsafe { libc::dlsym(libc::RTLD_DEFAULT, name.as_ptr()) };
        entry.store(found.addr(), Ordering::Relaxed);
    }
}

/// True when the program counter lies in one of them. Async-signal-safe.
#[must_use]
pub fn holds(pc: usize) -> bool {
    ENTRIES.iter().enumerate().any(|(index, entry)| {
        let extent = if index + 2 < NAMES.len() { EXTENT } else { EXTENT_SHORT };
        let entry = entry.load(Ordering::Relaxed);
        entry != 0 && (entry..entry + extent).contains(&pc)
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn memcpy_is_one_and_malloc_is_none() {
        super::install();
        let of = |name: &std::ffi::CStr| {
            // SAFETY: as in `install`.
            unsafe { libc::dlsym(libc::RTLD_DEFAULT, name.as_ptr()) }.addr()
        };
        assert!(super::holds(of(c"memcpy") + 16));
        assert!(!super::holds(of(c"malloc") + 16));
    }
}
