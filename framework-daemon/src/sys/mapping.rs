//! A part of a file as memory that outlives the process.
//!
//! The part is there before it is mapped (`posix_fallocate`), and each of its pages is written once: a full disk is an error
//! here, not a SIGBUS later.
//!
//! Who cuts the file short from outside takes the pages away all the same, and no lock keeps them from it. So the trap handler
//! asks here first: an empty page of no file takes the place of one that is gone, whoever touched it goes on, and that it
//! happened is told. What lay there has a checksum that it fails then. To look at the file's length before each copy was not
//! done: it may be cut right after.
#![allow(unsafe_code, reason = "address of unsafe: mmap")]

use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::ptr::NonNull;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU64, AtomicUsize, Ordering};

use crossbeam_channel::{Receiver, bounded};
use nix::fcntl::posix_fallocate;

use super::wake::Waker;
use super::{arch, thread};

/// Parts of files begin at multiples of this, in bytes.
pub const PAGE: usize = 4096;

/// A mapped part of a file.
#[derive(Debug)]
pub struct Mapping {
    start: NonNull<u8>,
    len: usize,
    entry: &'static Entry,
}

/// Where something is mapped, for the trap handler. Never freed, because it may be looking; used again.
#[derive(Debug)]
struct Entry {
    is_taken: AtomicBool,
    start: AtomicUsize,
    len: AtomicUsize,
    next: AtomicPtr<Self>,
}

/// The newest entry.
static ENTRIES: AtomicPtr<Entry> = AtomicPtr::new(std::ptr::null_mut());

/// All entries.
fn entries() -> impl Iterator<Item = &'static Entry> {
    let of = |pointer: &AtomicPtr<Entry>| {
        // SAFETY: null, or a box that was leaked.
        unsafe { pointer.load(Ordering::Acquire).as_ref() }
    };
    std::iter::successors(of(&ENTRIES), move |entry| of(&entry.next))
}

impl Entry {
    /// One for that memory: an old one that nobody uses, or a new one.
    fn take(start: usize, len: usize) -> &'static Self {
        let is_free = |entry: &&Self| !entry.is_taken.swap(true, Ordering::AcqRel);
        let entry = entries().find(is_free).unwrap_or_else(Self::new);
        entry.start.store(start, Ordering::SeqCst);
        entry.len.store(len, Ordering::SeqCst);
        entry
    }

    fn new() -> &'static Self {
        let (start, len) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let entry: &'static Self =
            Box::leak(Box::new(Self { is_taken: AtomicBool::new(true), start, len, next: AtomicPtr::default() }));
        let mut before = ENTRIES.load(Ordering::Acquire);
        loop {
            entry.next.store(before, Ordering::Release);
            let own = std::ptr::from_ref(entry).cast_mut();
            match ENTRIES.compare_exchange(before, own, Ordering::AcqRel, Ordering::Acquire) {
                Ok(_) => return entry,
                Err(other) => before = other,
            }
        }
    }

    fn give_back(&self) {
        self.len.store(0, Ordering::SeqCst);
        self.is_taken.store(false, Ordering::Release);
    }

    /// Length first: one that is being taken over by another mapping has none.
    fn holds(&self, address: usize) -> bool {
        let len = self.len.load(Ordering::SeqCst);
        let start = self.start.load(Ordering::SeqCst);
        address.checked_sub(start).is_some_and(|inside| inside < len) && len == self.len.load(Ordering::SeqCst)
    }
}

/// Somebody waits to be told that a file was cut short.
static LISTENER: OnceLock<Waker> = OnceLock::new();

/// Tells once, when a mapped file was cut short.
///
/// # Errors
/// When the system has no thread left.
pub fn listen() -> io::Result<Receiver<()>> {
    let (sender, receiver) = bounded(1);
    let waker = LISTENER.get_or_init(Waker::default);
    thread::spawn("mappings", move || {
        waker.wait_until(None);
        let _ = sender.send(());
    })?;
    Ok(receiver)
}

/// A trap by a page that its file no longer backs: where it is one of ours, an empty one is put in its place. True: whoever was
/// interrupted goes on. System calls only.
pub(super) fn patch(address: usize) -> bool {
    if !entries().any(|entry| entry.holds(address)) {
        return false;
    }
    let page = address / PAGE * PAGE;
    let access = (libc::PROT_READ | libc::PROT_WRITE) as usize;
    let flags = (libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED) as usize;
    // SAFETY: a page of a mapping of ours, whose holder is interrupted in using it; nothing was in it any more.
    let result = unsafe { arch::system_call(libc::SYS_mmap, [page, PAGE, access, flags, usize::MAX, 0]) };
    LISTENER.get().into_iter().for_each(Waker::wake);
    result == page.cast_signed()
}

// SAFETY: memory that belongs to whoever has the mapping.
unsafe impl Send for Mapping {}

impl Mapping {
    /// Makes room in the file for `len` bytes from `offset` on, both multiples of [`PAGE`], maps them and fills them with
    /// zeros.
    ///
    /// # Errors
    /// When the disk is full, or the file cannot be mapped.
    pub fn create(file: &File, offset: u64, len: usize) -> io::Result<Self> {
        let (from, length) = (offset.cast_signed(), len.cast_signed() as i64);
        if len == 0 || from < 0 || from.checked_add(length).is_none() {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        posix_fallocate(file, from, length)?;
        let (access, flags) = (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_SHARED);
        // SAFETY: a new mapping, of a file that is as long.
        let start = unsafe { libc::mmap(std::ptr::null_mut(), len, access, flags, file.as_raw_fd(), from) };
        if start == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        let start = NonNull::new(start.cast::<u8>()).ok_or(io::ErrorKind::OutOfMemory)?;
        let mapping = Self { start, len, entry: Entry::take(start.addr().get(), len) };
        // SAFETY: the mapping is as long, and nobody else's yet.
        unsafe { start.write_bytes(0, len) };
        Ok(mapping)
    }

    /// Where it begins.
    #[must_use]
    pub const fn start(&self) -> NonNull<u8> {
        self.start
    }

    /// Its bytes.
    #[must_use]
    pub const fn bytes(&self) -> &[u8] {
        // SAFETY: as long as it is mapped, and only its holder writes it.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }

    /// Its bytes, to be written.
    #[must_use]
    pub const fn bytes_mut(&mut self) -> &mut [u8] {
        // SAFETY: as above.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }
}

/// A word in a mapped part of a file, for any thread.
#[derive(Debug)]
pub struct Word(Mapping);

// SAFETY: the mapping is only reached through one atomic.
unsafe impl Sync for Word {}

impl Word {
    /// The first word of a part of that file, which is made and filled with zeros.
    ///
    /// # Errors
    /// As [`Mapping::create`].
    pub fn create(file: &File, offset: u64) -> io::Result<Self> {
        Mapping::create(file, offset, PAGE).map(Self)
    }

    /// The word; where somebody cut the file short it is 0 from then on.
    #[must_use]
    pub const fn get(&self) -> &AtomicU64 {
        // SAFETY: a page is mapped as long as `self` is, aligned as a page is, and nobody reaches it but through here.
        unsafe { AtomicU64::from_ptr(self.0.start.as_ptr().cast()) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        self.entry.give_back();
        // SAFETY: mapped in `create`, and nobody uses it any more.
        unsafe { libc::munmap(self.start.as_ptr().cast(), self.len) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_in_the_file() {
        let file = tempfile::tempfile().unwrap();
        let mut mapping = Mapping::create(&file, PAGE as u64, PAGE).unwrap();
        mapping.bytes_mut()[5] = 7;
        drop(mapping);
        let mut read = [0; 2 * PAGE];
        std::os::unix::fs::FileExt::read_exact_at(&file, &mut read, 0).unwrap();
        assert_eq!(read[PAGE + 5], 7);
    }

    #[test]
    fn a_word_is_in_the_file_at_once() {
        let file = tempfile::tempfile().unwrap();
        let word = Word::create(&file, PAGE as u64).unwrap();
        word.get().store(0x0102, Ordering::SeqCst);
        let mut read = [0; 8];
        std::os::unix::fs::FileExt::read_exact_at(&file, &mut read, PAGE as u64).unwrap();
        assert_eq!(u64::from_ne_bytes(read), 0x0102);
    }

    #[test]
    fn what_is_mapped_is_known_as_long_as_it_is() {
        let file = tempfile::tempfile().unwrap();
        let mapping = Mapping::create(&file, 0, 2 * PAGE).unwrap();
        let start = mapping.start().addr().get();
        let is_known = |address: usize| entries().any(|entry| entry.holds(address));
        assert!(is_known(start) && is_known(start + 2 * PAGE - 1) && !is_known(8));
        drop(mapping);
        assert!(entries().all(|entry| entry.start.load(Ordering::SeqCst) != start || !entry.holds(start)));
        let free = entries().count();
        drop(Mapping::create(&file, 0, PAGE).unwrap());
        assert!(entries().count() <= free + 1, "entries are used again");
    }

    #[test]
    fn a_page_that_was_cut_off_is_an_empty_one() {
        crate::sys::trap::install();
        let file = tempfile::tempfile().unwrap();
        let mut mapping = Mapping::create(&file, 0, 3 * PAGE).unwrap();
        mapping.bytes_mut().fill(7);
        file.set_len(PAGE as u64).unwrap();
        assert_eq!((mapping.bytes()[0], mapping.bytes()[PAGE], mapping.bytes()[3 * PAGE - 1]), (7, 0, 0));
        mapping.bytes_mut()[PAGE] = 9;
        assert_eq!(mapping.bytes()[PAGE], 9, "it serves as before");
    }

    #[test]
    fn where_there_is_no_room_nothing_is_mapped() {
        let full = File::options().read(true).write(true).open("/dev/full").unwrap();
        assert!(Mapping::create(&full, 0, PAGE).is_err());
        let file = tempfile::tempfile().unwrap();
        assert!(Mapping::create(&file, 0, 0).is_err());
        assert!(Mapping::create(&file, u64::MAX, PAGE).is_err());
    }
}
