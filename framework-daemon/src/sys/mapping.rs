//! A part of a file as memory that outlives the process.
//!
//! The part is there before it is mapped (`posix_fallocate`), and each of its pages is written once: a full disk is an error
//! here, not a SIGBUS later.
#![allow(unsafe_code, reason = "address of unsafe: mmap")]

use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::ptr::NonNull;

use nix::fcntl::posix_fallocate;

/// Parts of files begin at multiples of this, in bytes.
pub const PAGE: usize = 4096;

/// A mapped part of a file.
#[derive(Debug)]
pub struct Mapping {
    start: NonNull<u8>,
    len: usize,
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
        // SAFETY: the mapping is as long, and nobody else's yet.
        unsafe { start.write_bytes(0, len) };
        Ok(Self { start, len })
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

impl Drop for Mapping {
    fn drop(&mut self) {
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
    fn where_there_is_no_room_nothing_is_mapped() {
        let full = File::options().read(true).write(true).open("/dev/full").unwrap();
        assert!(Mapping::create(&full, 0, PAGE).is_err());
        let file = tempfile::tempfile().unwrap();
        assert!(Mapping::create(&file, 0, 0).is_err());
        assert!(Mapping::create(&file, u64::MAX, PAGE).is_err());
    }
}
