//! Where the daemon comes by its descriptors: the functions of the C library that it and its libraries call for that. Each
//! does what it always did, and notes whose the new number is (`descriptors`).
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use std::ffi::{c_char, c_int, c_uint};

use libc::{DIR, mode_t, sockaddr, socklen_t};

use super::descriptors::{forget, note};
use super::{Real, Reals, missing};

type Open = unsafe extern "C" fn(*const c_char, c_int, mode_t) -> c_int;
type Accept = unsafe extern "C" fn(c_int, *mut sockaddr, *mut socklen_t, c_int) -> c_int;

// SAFETY: path, flags and a mode, passed whether it is there or not; returns a descriptor.
static OPEN: Real<Open> = unsafe { Real::new(c"open64") };
// SAFETY: descriptor, address to be filled, its length and flags, returns a descriptor.
static ACCEPT: Real<Accept> = unsafe { Real::new(c"accept4") };
// SAFETY: family, kind and protocol, returns a descriptor.
static SOCKET: Real<extern "C" fn(c_int, c_int, c_int) -> c_int> = unsafe { Real::new(c"socket") };
// SAFETY: the same and two numbers to be filled, returns a status.
static PAIR: Real<unsafe extern "C" fn(c_int, c_int, c_int, *mut c_int) -> c_int> = unsafe { Real::new(c"socketpair") };
// SAFETY: two numbers to be filled and flags, returns a status.
static PIPE: Real<unsafe extern "C" fn(*mut c_int, c_int) -> c_int> = unsafe { Real::new(c"pipe2") };
// SAFETY: name and flags, returns a descriptor.
static MEMORY: Real<unsafe extern "C" fn(*const c_char, c_uint) -> c_int> = unsafe { Real::new(c"memfd_create") };
// SAFETY: path, returns a directory or null.
static OPEN_DIRECTORY: Real<unsafe extern "C" fn(*const c_char) -> *mut DIR> = unsafe { Real::new(c"opendir") };
// SAFETY: a directory, returns a status.
static CLOSE_DIRECTORY: Real<unsafe extern "C" fn(*mut DIR) -> c_int> = unsafe { Real::new(c"closedir") };

pub(super) static REALS: Reals = &[&OPEN, &ACCEPT, &SOCKET, &PAIR, &PIPE, &MEMORY, &OPEN_DIRECTORY, &CLOSE_DIRECTORY];

/// True for the commands by which `fcntl` makes a descriptor.
pub(super) fn is_dup(command: c_int) -> bool {
    matches!(command, libc::F_DUPFD | libc::F_DUPFD_CLOEXEC)
}

/// Notes both, where they were made.
unsafe fn note_both(status: c_int, made: *const c_int) -> c_int {
    if status == 0 {
        // SAFETY: the call that made them has filled both.
        unsafe { [*made, *made.add(1)].into_iter().for_each(|fd| _ = note(fd)) };
    }
    status
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn open64(path: *const c_char, flags: c_int, mode: mode_t) -> c_int {
    // SAFETY: passed on.
    note(OPEN.get().map_or_else(missing, |real| unsafe { real(path, flags, mode) }))
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn accept4(fd: c_int, address: *mut sockaddr, length: *mut socklen_t, flags: c_int) -> c_int {
    // SAFETY: passed on.
    note(ACCEPT.get().map_or_else(missing, |real| unsafe { real(fd, address, length, flags) }))
}

/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn socket(family: c_int, kind: c_int, protocol: c_int) -> c_int {
    note(SOCKET.get().map_or_else(missing, |real| real(family, kind, protocol)))
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn socketpair(family: c_int, kind: c_int, protocol: c_int, made: *mut c_int) -> c_int {
    // SAFETY: passed on.
    unsafe { note_both(PAIR.get().map_or_else(missing, |real| real(family, kind, protocol, made)), made) }
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn pipe2(made: *mut c_int, flags: c_int) -> c_int {
    // SAFETY: passed on.
    unsafe { note_both(PIPE.get().map_or_else(missing, |real| real(made, flags)), made) }
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn memfd_create(name: *const c_char, flags: c_uint) -> c_int {
    // SAFETY: passed on.
    note(MEMORY.get().map_or_else(missing, |real| unsafe { real(name, flags) }))
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn opendir(path: *const c_char) -> *mut DIR {
    // SAFETY: passed on.
    let made = OPEN_DIRECTORY.get().map_or(std::ptr::null_mut(), |real| unsafe { real(path) });
    if !made.is_null() {
        // SAFETY: the call has just made it.
        note(unsafe { libc::dirfd(made) });
    }
    made
}

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn closedir(directory: *mut DIR) -> c_int {
    // SAFETY: the caller's directory is valid, as for the C library's function.
    let fd = if directory.is_null() { -1 } else { unsafe { libc::dirfd(directory) } };
    // SAFETY: passed on.
    let result = CLOSE_DIRECTORY.get().map_or_else(missing, |real| unsafe { real(directory) });
    forget(fd);
    result
}
