//! Reads memory of this process that may not be there. The kernel copies it, so that a wild address is an answer and no trap:
//! a guarded fiber, which recovers from the trap, was the alternative, and needs a thread of its own.

use std::io::IoSliceMut;
use std::ops::Range;

use nix::sys::uio::{RemoteIoVec, process_vm_readv};
use nix::unistd::Pid;

/// Bytes that are read ahead.
const WINDOW_BYTES: usize = 4_096;

/// Looks at memory, a window at a time.
#[derive(Debug, Default)]
pub struct Peek {
    start: usize,
    window: Vec<u8>,
}

impl Peek {
    /// The bytes at that address; `None`: they are not there, or not to be read.
    pub fn at(&mut self, address: usize, len: usize) -> Option<&[u8]> {
        if self.place(address, len).is_none() {
            self.fetch(address, len)?;
        }
        let place = self.place(address, len)?;
        self.window.get(place)
    }

    fn place(&self, address: usize, len: usize) -> Option<Range<usize>> {
        let from = address.checked_sub(self.start)?;
        let to = from.checked_add(len)?;
        (to <= self.window.len()).then_some(from..to)
    }

    fn fetch(&mut self, address: usize, len: usize) -> Option<()> {
        for wanted in [len.max(WINDOW_BYTES), len] {
            self.start = address;
            self.window.resize(wanted, 0);
            let remote = [RemoteIoVec { base: address, len: wanted }];
            let read = process_vm_readv(Pid::this(), &mut [IoSliceMut::new(&mut self.window)], &remote);
            self.window.truncate(read.unwrap_or_default());
            if self.window.len() >= len {
                return Some(());
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_is_read_and_what_is_not_is_told() {
        let mut peek = Peek::default();
        let bytes: Vec<u8> = (0..=255).cycle().take(20_000).collect();
        let address = bytes.as_ptr().addr();
        assert_eq!(peek.at(address, bytes.len()), Some(&bytes[..]));
        assert_eq!(peek.at(address + 300, 3), Some(&bytes[300..303]), "out of the same window");
        for wild in [8, 0xdead_0000_0000, usize::MAX - 3, usize::MAX] {
            assert_eq!(peek.at(wild, 8), None);
        }
        assert_eq!(peek.at(address, 1), Some(&bytes[..1]));
    }
}
