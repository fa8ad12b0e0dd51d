//! Descriptors of the daemon: a plugin that closes, overwrites or changes one (an ordinary mistake: it closes its own twice,
//! and the number has another owner by then) is told that it has none of that number, and the log tells who did it. Not a
//! fault: that is how the kernel answers a wrong number, and a component that closes all it can see means well.
//!
//! What the daemon opens is noted where it opens it ([`opens`]), outside of plugin code, until it closes it. The
//! reverse, to note what plugins open and to refuse all else, failed: there are too many ways to come by a descriptor (`fopen`,
//! a message, a library's own system calls), and one that is missed would never be closed again. What is missed here
//! is as exposed as it was: a number between the kernel and the note, what the C library opens inside for a moment (the
//! loader, `posix_spawn`). A list that each part of the daemon enters its descriptors into would not know those that live for
//! a moment only, and these are the ones whose numbers go round.
#![allow(unsafe_code, reason = "address of unsafe: symbol interposition")]

use std::ffi::{c_int, c_uint, c_ulong};
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering};

use libc::off_t;

use super::{Caller, Real, Reals, caller, is_child, missing, opens};
use crate::sys::{arch, log_ring, seat};

// SAFETY: descriptor, returns a status.
static CLOSE: Real<extern "C" fn(c_int) -> c_int> = unsafe { Real::new(c"close") };
// SAFETY: two descriptors, returns the second.
static DUP2: Real<extern "C" fn(c_int, c_int) -> c_int> = unsafe { Real::new(c"dup2") };
// SAFETY: two descriptors and flags, returns the second.
static DUP3: Real<extern "C" fn(c_int, c_int, c_int) -> c_int> = unsafe { Real::new(c"dup3") };
// SAFETY: first and last descriptor and flags, returns a status.
static CLOSE_RANGE: Real<extern "C" fn(c_uint, c_uint, c_int) -> c_int> = unsafe { Real::new(c"close_range") };
// SAFETY: descriptor and length, returns a status.
static TRUNCATE: Real<extern "C" fn(c_int, off_t) -> c_int> = unsafe { Real::new(c"ftruncate") };
// SAFETY: descriptor and direction, returns a status.
static SHUTDOWN: Real<extern "C" fn(c_int, c_int) -> c_int> = unsafe { Real::new(c"shutdown") };
// SAFETY: descriptor, command and a word, passed whether it is there or not; returns a number.
static CONTROL: Real<unsafe extern "C" fn(c_int, c_int, usize) -> c_int> = unsafe { Real::new(c"fcntl") };
// SAFETY: as above.
static DEVICE: Real<unsafe extern "C" fn(c_int, c_ulong, usize) -> c_int> = unsafe { Real::new(c"ioctl") };

pub(super) static REALS: Reals = &[&CLOSE, &DUP2, &DUP3, &CLOSE_RANGE, &TRUNCATE, &SHUTDOWN, &CONTROL, &DEVICE];

/// Numbers from here on are not noted: a daemon that has so many open has other troubles.
const NOTED: u32 = 1 << 16;

/// How often each is the daemon's: twice, where a thread has it again before the one that closes it is back.
static OWN: [AtomicU8; NOTED as usize] = [const { AtomicU8::new(0) }; NOTED as usize];

/// No more threads than that are in `close` with one number; what is noted and closed elsewhere does not add up.
const OWNERS: u8 = 3;

fn place(fd: c_int) -> Option<&'static AtomicU8> {
    OWN.get(usize::try_from(fd).ok()?)
}

fn is_own(fd: c_int) -> bool {
    place(fd).is_some_and(|owners| owners.load(Ordering::Acquire) > 0)
}

fn update(owners: &AtomicU8, new: impl Fn(u8) -> u8) {
    let _ = owners.fetch_update(Ordering::AcqRel, Ordering::Acquire, |present| Some(new(present)));
}

/// The process began with these.
pub(super) fn own_streams() {
    (0..=libc::STDERR_FILENO).filter_map(place).for_each(|owners| owners.store(1, Ordering::Release));
}

/// The kernel has just given that number to whoever runs here. A child that shares our memory has numbers of its own.
pub(super) fn note(fd: c_int) -> c_int {
    let Some(owners) = place(fd) else { return fd };
    if caller() != Caller::Daemon {
        // One of the daemon's that the C library closed inside.
        owners.store(0, Ordering::Release);
    } else if !is_child() {
        update(owners, |present| (present + 1).min(OWNERS));
    }
    fd
}

/// The daemon has closed it. Not before: a component might close it in between, and the daemon somebody else's.
pub(super) fn forget(fd: c_int) {
    if let Some(owners) = place(fd).filter(|_| is_own(fd) && caller() == Caller::Daemon && !is_child()) {
        update(owners, |present| present.saturating_sub(1));
    }
}

/// True where plugin code means one of the daemon's.
pub(in crate::sys) fn refuses(fd: c_int) -> bool {
    let is_refused = is_own(fd) && caller() != Caller::Daemon;
    if is_refused {
        tell();
    }
    is_refused
}

/// Address of the name of the slot that was told of last: one line for it, not one for each number that it tries.
static TOLD: AtomicUsize = AtomicUsize::new(0);

fn tell() {
    let (slot, text) =
        (seat::owner().slot, "refused: it closes or changes a descriptor of the daemon (one closed twice?)");
    let address = slot.as_ptr().addr();
    if TOLD.swap(address, Ordering::Relaxed) != address {
        log_ring::put(2, slot, text);
    }
}

fn refused() -> c_int {
    fail(libc::EBADF)
}

fn fail(error: c_int) -> c_int {
    // SAFETY: the address of this thread's `errno`.
    unsafe { *libc::__errno_location() = error };
    -1
}

/// As `close_range` for plugin code: closes what of it is not the daemon's. All threads keep one table. Returns what the
/// kernel says.
pub(in crate::sys) fn close_others(first: c_uint, last: c_uint, flags: c_uint) -> isize {
    let flags = flags & !libc::CLOSE_RANGE_UNSHARE;
    let call = |first: c_uint, last: c_uint| {
        // SAFETY: numbers only.
        unsafe { arch::system_call(libc::SYS_close_range, [first as usize, last as usize, flags as usize, 0, 0, 0]) }
    };
    let mut from = first;
    // To be closed in programs to come does them no harm.
    let spares = flags & libc::CLOSE_RANGE_CLOEXEC == 0;
    for own in (first..=last.min(NOTED - 1)).filter(|fd| spares && is_own(*fd as c_int)) {
        if from < own && call(from, own - 1) < 0 {
            break;
        }
        from = own + 1;
    }
    if from <= last || first > last { call(from, last) } else { 0 }
}

/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn close(fd: c_int) -> c_int {
    if refuses(fd) {
        return refused();
    }
    let result = CLOSE.get().map_or_else(missing, |real| real(fd));
    forget(fd);
    result
}

/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn dup2(from: c_int, to: c_int) -> c_int {
    if refuses(to) { refused() } else { DUP2.get().map_or_else(missing, |real| real(from, to)) }
}

/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn dup3(from: c_int, to: c_int, flags: c_int) -> c_int {
    if refuses(to) { refused() } else { DUP3.get().map_or_else(missing, |real| real(from, to, flags)) }
}

/// As the C library's; what is the daemon's stays open.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn close_range(first: c_uint, last: c_uint, flags: c_int) -> c_int {
    if caller() == Caller::Daemon {
        return CLOSE_RANGE.get().map_or_else(missing, |real| real(first, last, flags));
    }
    match close_others(first, last, flags as c_uint) {
        error @ ..0 => fail(-error as c_int),
        _ => 0,
    }
}

/// As [`close_range`] from that one on.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn closefrom(low: c_int) {
    close_range(low.max(0) as c_uint, c_uint::MAX, 0);
}

/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn ftruncate(fd: c_int, length: off_t) -> c_int {
    if refuses(fd) { refused() } else { TRUNCATE.get().map_or_else(missing, |real| real(fd, length)) }
}

/// As [`ftruncate`]: the same function where words have 64 bits.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn ftruncate64(fd: c_int, length: off_t) -> c_int {
    ftruncate(fd, length)
}

/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub extern "C" fn shutdown(fd: c_int, how: c_int) -> c_int {
    if refuses(fd) { refused() } else { SHUTDOWN.get().map_or_else(missing, |real| real(fd, how)) }
}

/// What `fcntl` changes in what the daemon shares with nobody: flags, locks, whom it signals.
const CHANGES: [c_int; 4] = [libc::F_SETFL, libc::F_SETLK, libc::F_SETLKW, libc::F_SETOWN];

/// As the C library's.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn fcntl(fd: c_int, command: c_int, argument: usize) -> c_int {
    if CHANGES.contains(&command) && refuses(fd) {
        return refused();
    }
    // SAFETY: passed on.
    let result = CONTROL.get().map_or_else(missing, |real| unsafe { real(fd, command, argument) });
    if opens::is_dup(command) { note(result) } else { result }
}

/// As [`fcntl`]: the same function where words have 64 bits.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn fcntl64(fd: c_int, command: c_int, argument: usize) -> c_int {
    // SAFETY: passed on.
    unsafe { fcntl(fd, command, argument) }
}

/// As the C library's; whether a descriptor of the daemon waits is not for plugins to say.
///
/// # Safety
/// As the C library's.
#[cfg_attr(not(miri), unsafe(no_mangle))]
pub unsafe extern "C" fn ioctl(fd: c_int, request: c_ulong, argument: usize) -> c_int {
    if matches!(request, libc::FIONBIO | libc::FIOASYNC) && refuses(fd) {
        return refused();
    }
    // SAFETY: passed on.
    DEVICE.get().map_or_else(missing, |real| unsafe { real(fd, request, argument) })
}
