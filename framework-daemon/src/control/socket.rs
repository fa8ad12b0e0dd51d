//! Where the control socket is, how it is taken, and who may use it.
//!
//! Two daemons that start at once must not take the socket from each other: whoever looks whether a socket is stale holds a
//! lock on its directory meanwhile. A lock file was the alternative; it stays behind, and removing it races as well.

use std::fs::{DirBuilder, File};
use std::io;
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::{DirBuilderExt, FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg};
use nix::sys::socket::{self, AddressFamily, Backlog, SockFlag, SockType, UnixAddr, UnixCredentials, sockopt};
use nix::unistd::{getegid, geteuid};

/// Who may write to the socket's file may connect: the owner and the group.
const MODE: u32 = 0o660;

/// The directory of the system's socket, and of a user's.
const DIRECTORY: &str = "framework-daemon";

/// The file in it.
const FILE: &str = "control.sock";

/// Another daemon that starts holds the lock for microseconds.
const LOCK_PATIENCE: Duration = Duration::from_secs(2);

/// Where the socket may be, where nobody said: a user's first, then the system's.
#[must_use]
pub fn places() -> Vec<PathBuf> {
    let own = std::env::var_os("XDG_RUNTIME_DIR").filter(|value| !value.is_empty()).map(PathBuf::from);
    own.into_iter().chain([PathBuf::from("/run")]).map(|base| base.join(DIRECTORY).join(FILE)).collect()
}

/// The socket, taken. Its file is removed when this is dropped.
#[derive(Debug)]
pub struct Socket {
    /// Where clients arrive.
    pub listener: UnixListener,
    path: PathBuf,
    /// Device and number of its file.
    identity: (u64, u64),
}

impl Socket {
    /// Takes the socket at `path`; a stale one is replaced.
    ///
    /// # Errors
    /// In words, when it is not permitted, or a living daemon has it.
    pub fn take(path: &Path) -> Result<Self, String> {
        Self::try_take(path).map_err(|reason| format!("control socket {}: {reason}", path.display()))
    }

    /// Takes the socket where nobody said where; makes its directory where there is none.
    ///
    /// # Errors
    /// As [`Self::take`].
    pub fn take_default() -> Result<Self, String> {
        let Some(path) = places().into_iter().next() else { return Err("no place for the control socket".to_owned()) };
        let directory = path.parent().unwrap_or(&path);
        match DirBuilder::new().mode(0o750).create(directory) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                Err(format!("control socket: {}: {error}", directory.display()))
            }
            _ => Self::take(&path),
        }
    }

    fn try_take(path: &Path) -> Result<Self, String> {
        let address = UnixAddr::new(path).map_err(|_| "the path is too long for a socket: 107 bytes at most")?;
        let _lock = lock(path)?;
        clear_stale(path)?;
        let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
        let socket = socket::socket(AddressFamily::Unix, SockType::Stream, flags, None).map_err(words)?;
        socket::bind(socket.as_raw_fd(), &address).map_err(words)?;
        // Nobody can connect before it listens: its mode is right by then.
        let opened = open(path, &socket);
        let identity = opened.inspect_err(|_| _ = std::fs::remove_file(path)).map_err(|error| error.to_string())?;
        Ok(Self { listener: UnixListener::from(socket), path: path.to_owned(), identity })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Socket {
    /// Another daemon's socket that stands there by now is left alone.
    fn drop(&mut self) {
        if identity(&self.path).is_ok_and(|identity| identity == self.identity) {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

fn open(path: &Path, socket: &OwnedFd) -> io::Result<(u64, u64)> {
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(MODE))?;
    socket::listen(socket, Backlog::MAXCONN)?;
    identity(path)
}

fn identity(path: &Path) -> io::Result<(u64, u64)> {
    std::fs::symlink_metadata(path).map(|found| (found.dev(), found.ino()))
}

fn words(error: Errno) -> String {
    io::Error::from(error).to_string()
}

/// Locks the directory of `path`.
fn lock(path: &Path) -> Result<Flock<File>, String> {
    let directory = path.parent().filter(|directory| !directory.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = File::open(directory).map_err(|error| format!("its directory: {error}"))?;
    let began = Instant::now();
    loop {
        match Flock::lock(file, FlockArg::LockExclusiveNonblock) {
            Ok(lock) => return Ok(lock),
            Err((_, error)) if began.elapsed() > LOCK_PATIENCE => {
                return Err(format!("its directory is locked by somebody else: {}", words(error)));
            }
            Err((again, _)) => file = again,
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Removes a socket that nobody listens on.
fn clear_stale(path: &Path) -> Result<(), String> {
    match std::fs::symlink_metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(error.to_string()),
        Ok(found) if !found.file_type().is_socket() => return Err("there is a file that is no socket".to_owned()),
        Ok(_) => {}
    }
    match try_connect(path) {
        Err(Errno::ECONNREFUSED) => std::fs::remove_file(path).map_err(|error| format!("a stale socket: {error}")),
        Err(Errno::ENOENT) => Ok(()),
        // A full queue of clients (EAGAIN) is a daemon's that lives.
        Ok(()) | Err(Errno::EAGAIN) => Err("another daemon has it; choose another one by --socket PATH".to_owned()),
        Err(error) => Err(words(error)),
    }
}

/// Without waiting: a daemon that is stopped by a debugger lets its clients wait.
fn try_connect(path: &Path) -> Result<(), Errno> {
    let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
    let socket = socket::socket(AddressFamily::Unix, SockType::Stream, flags, None)?;
    socket::connect(socket.as_raw_fd(), &UnixAddr::new(path)?)
}

/// Whether who is at the other end may use the socket.
///
/// # Errors
/// In words, when it may not.
pub fn check_peer(stream: &UnixStream) -> Result<(), String> {
    let peer = socket::getsockopt(stream, sockopt::PeerCredentials).map_err(words)?;
    permit(&peer, geteuid().as_raw(), getegid().as_raw())
}

/// Root, the daemon's own user and its own group. The kernel tells the peer's main group only.
fn permit(peer: &UnixCredentials, uid: u32, gid: u32) -> Result<(), String> {
    if peer.uid() == 0 || peer.uid() == uid || peer.gid() == gid {
        return Ok(());
    }
    Err(format!(
        "user {} with main group {} may not use this daemon: run it as root, as user {uid}, or with main group {gid} (`sg`)",
        peer.uid(),
        peer.gid()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stale_socket_is_replaced_a_living_one_and_other_files_are_not() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("control.sock");
        drop(UnixListener::bind(&path).unwrap());
        assert!(path.exists(), "stale");
        let socket = Socket::take(&path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().mode() & 0o7777, MODE);
        assert!(UnixStream::connect(&path).is_ok());
        assert!(Socket::take(&path).unwrap_err().contains("another daemon has it"));
        drop(socket);
        assert!(!path.exists(), "removed in the end");
        std::fs::write(&path, "precious").unwrap();
        assert!(Socket::take(&path).unwrap_err().contains("no socket"));
        assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    }

    #[test]
    fn a_successors_socket_is_left_alone() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("control.sock");
        let first = Socket::take(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let second = Socket::take(&path).unwrap();
        drop(first);
        assert!(path.exists());
        drop(second);
        assert!(!path.exists());
    }

    #[test]
    fn many_at_once_take_one_socket_once() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("control.sock");
        drop(UnixListener::bind(&path).unwrap());
        let taken: Vec<_> = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| Socket::take(&path))).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert_eq!(taken.iter().filter(|socket| socket.is_ok()).count(), 1, "{taken:?}");
    }

    #[test]
    fn what_cannot_be_taken_is_said_in_words() {
        let long = format!("/tmp/{}", "x".repeat(200));
        assert!(Socket::take(Path::new(&long)).unwrap_err().contains("too long"));
        assert!(Socket::take(Path::new("/nowhere/at/all.sock")).unwrap_err().contains("its directory"));
    }

    #[test]
    fn strangers_are_refused_with_the_way_out() {
        // As far as the structure lets itself be made: this process's own credentials.
        let own = UnixCredentials::new();
        assert!(permit(&own, own.uid(), 77).is_ok());
        assert!(permit(&own, 77, own.gid()).is_ok());
        let stranger = UnixCredentials::from(libc::ucred { pid: 1, uid: 4242, gid: 4243 });
        assert!(permit(&stranger, 4242, 1).is_ok());
        assert!(permit(&stranger, 1, 4243).is_ok());
        assert!(permit(&stranger, 1, 1).unwrap_err().contains("as user 1"));
    }
}
