//! The board's end of a serial line: a pseudo-terminal whose other end a driver opens like any serial device.
//!
//! Decision: the simulator keeps a descriptor of the driver's end open too. Without it the line reads as broken from
//! the moment the driver closes until it opens again, and `TIOCEXCL`, which serial libraries set and do not take back,
//! would outlive the driver and lock its successor out. With it we can take the flag back and throw away what nobody
//! read. `nix` has no safe call for that flag, hence `rustix`.

use std::ffi::OsStr;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use rustix::io::Errno;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, ioctl_tiocnxcl, tcflush, tcgetattr, tcsetattr};

use super::ServeError;

/// More unread bytes than this (a fifth of a second of telemetry) means that nobody reads: a real line would have
/// lost them, and a driver that opens now must not be fed the past.
const STALE_BYTES: u64 = 512;

/// A pseudo-terminal with a name of our choice.
pub struct Pty {
    board: OwnedFd,
    driver: OwnedFd,
    device: PathBuf,
    link: PathBuf,
    dropped: u64,
}

impl Pty {
    /// Makes the pseudo-terminal and the symbolic link `link` to it. An old link is replaced.
    ///
    /// # Errors
    /// The system has no more pseudo-terminals, or `link` exists and is not a link, or cannot be made.
    pub fn open(link: &Path) -> Result<Self, ServeError> {
        let (board, device, driver) =
            pair().map_err(|errno| ServeError::system("make a pseudo-terminal for", link)(errno.into()))?;
        place_link(link, &device)?;
        Ok(Self { board, driver, device, link: link.to_owned(), dropped: 0 })
    }

    /// The device behind the link.
    #[must_use]
    pub fn device(&self) -> &Path {
        &self.device
    }

    /// For waiting until the driver has written something.
    #[must_use]
    pub fn readable(&self) -> BorrowedFd<'_> {
        self.board.as_fd()
    }

    /// Telemetry bytes that nobody read and that were thrown away.
    #[must_use]
    pub fn dropped_bytes(&self) -> u64 {
        self.dropped
    }

    /// What the driver has written since the last call, at most one buffer; empty when there is nothing.
    ///
    /// # Errors
    /// The line is broken, which does not happen while we hold both ends.
    pub fn read<'a>(&self, buffer: &'a mut [u8]) -> io::Result<&'a [u8]> {
        match rustix::io::read(&self.board, &mut *buffer) {
            Ok(length) => Ok(&buffer[..length]),
            Err(Errno::AGAIN | Errno::INTR) => Ok(&[]),
            Err(broken) => Err(broken.into()),
        }
    }

    /// Sends `bytes`; never waits. What does not fit is lost, as on a real line.
    ///
    /// # Errors
    /// The line is broken, which does not happen while we hold both ends.
    pub fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        ioctl_tiocnxcl(&self.driver)?;
        let unread = rustix::io::ioctl_fionread(&self.driver)?;
        if unread > STALE_BYTES {
            tcflush(&self.driver, QueueSelector::IFlush)?;
            self.dropped += unread;
        }
        match rustix::io::write(&self.board, bytes) {
            Ok(sent) => self.dropped += (bytes.len() - sent) as u64,
            Err(Errno::AGAIN | Errno::INTR) => self.dropped += bytes.len() as u64,
            Err(broken) => return Err(broken.into()),
        }
        Ok(())
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        // Only our own link: a second simulator may have replaced it.
        if std::fs::read_link(&self.link).is_ok_and(|device| device == self.device) {
            let _gone_already = std::fs::remove_file(&self.link);
        }
    }
}

fn pair() -> Result<(OwnedFd, PathBuf, OwnedFd), Errno> {
    let board = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
    grantpt(&board)?;
    unlockpt(&board)?;
    let device = PathBuf::from(OsStr::from_bytes(ptsname(&board, Vec::new())?.as_bytes()));
    let flags = rustix::fs::OFlags::RDWR | rustix::fs::OFlags::NOCTTY | rustix::fs::OFlags::CLOEXEC;
    let driver = rustix::fs::open(&device, flags, rustix::fs::Mode::empty())?;
    let mut settings = tcgetattr(&driver)?;
    settings.make_raw();
    tcsetattr(&driver, OptionalActions::Now, &settings)?;
    rustix::io::ioctl_fionbio(&board, true)?;
    Ok((board, device, driver))
}

fn place_link(link: &Path, device: &Path) -> Result<(), ServeError> {
    match std::fs::symlink_metadata(link) {
        Ok(there) if there.is_symlink() => {
            std::fs::remove_file(link).map_err(ServeError::system("replace", link))?;
        }
        Ok(_) => return Err(ServeError::Taken { path: link.display().to_string(), what: "not a symbolic link" }),
        Err(_absent) => {}
    }
    std::os::unix::fs::symlink(device, link).map_err(ServeError::system("make the link", link))
}
