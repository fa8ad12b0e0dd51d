//! The camera's Unix socket: every client gets every frame it has time for.
//!
//! Per frame: `FRAM`, u32 width, u32 height, u32 seq, u64 time in microseconds, then the RGB rows; little-endian.
//! A client that has not taken its last frame yet misses the next one, so a slow client sees fewer frames, not old
//! ones, and costs nobody else anything.

use std::io::{ErrorKind, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::ServeError;
use crate::camera::{Frame, HEIGHT, WIDTH};

/// First bytes of every frame.
pub const MAGIC: [u8; 4] = *b"FRAM";
/// Bytes before the picture.
pub const HEADER_BYTES: usize = 24;
/// More clients than this are turned away.
const MAX_CLIENTS: usize = 16;

/// Serves camera frames.
pub struct CameraSocket {
    listener: UnixListener,
    path: PathBuf,
    clients: Vec<Client>,
}

struct Client {
    stream: UnixStream,
    frame: Arc<[u8]>,
    sent: usize,
}

impl CameraSocket {
    /// Listens at `path`. The socket of a simulator that is gone is replaced.
    ///
    /// # Errors
    /// `path` is in use or is no socket, or cannot be made.
    pub fn open(path: &Path) -> Result<Self, ServeError> {
        make_room(path)?;
        let listener = UnixListener::bind(path).map_err(ServeError::system("listen at", path))?;
        listener.set_nonblocking(true).map_err(ServeError::system("listen at", path))?;
        Ok(Self { listener, path: path.to_owned(), clients: Vec::new() })
    }

    /// Number of clients connected.
    #[must_use]
    pub fn clients(&self) -> usize {
        self.clients.len()
    }

    /// Takes in new clients and sends on what the present ones have room for. Never waits.
    pub fn tend(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            if self.clients.len() < MAX_CLIENTS && stream.set_nonblocking(true).is_ok() {
                self.clients.push(Client { stream, frame: Arc::new([]), sent: 0 });
            }
        }
        self.clients.retain_mut(Client::send);
    }

    /// Offers a new frame to every client.
    pub fn offer(&mut self, frame: &Frame) {
        self.tend();
        if self.clients.is_empty() {
            return;
        }
        let bytes: Arc<[u8]> = encoded(frame).into();
        for client in self.clients.iter_mut().filter(|client| client.sent == client.frame.len()) {
            client.frame = Arc::clone(&bytes);
            client.sent = 0;
        }
        self.clients.retain_mut(Client::send);
    }
}

impl Client {
    /// Sends on; false when the client has left.
    fn send(&mut self) -> bool {
        while self.sent < self.frame.len() {
            match self.stream.write(&self.frame[self.sent..]) {
                Ok(0) => return false,
                Ok(count) => self.sent += count,
                Err(full) if full.kind() == ErrorKind::WouldBlock => return true,
                Err(again) if again.kind() == ErrorKind::Interrupted => {}
                Err(_left) => return false,
            }
        }
        true
    }
}

impl Drop for CameraSocket {
    fn drop(&mut self) {
        let _gone_already = std::fs::remove_file(&self.path);
    }
}

/// `frame` as it goes over the socket.
#[must_use]
pub fn encoded(frame: &Frame) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER_BYTES + frame.rgb.len());
    bytes.extend(MAGIC);
    bytes.extend((WIDTH as u32).to_le_bytes());
    bytes.extend((HEIGHT as u32).to_le_bytes());
    bytes.extend(frame.seq.to_le_bytes());
    bytes.extend(frame.time_us.to_le_bytes());
    bytes.extend(&frame.rgb);
    bytes
}

fn make_room(path: &Path) -> Result<(), ServeError> {
    use std::os::unix::fs::FileTypeExt;
    let taken = |what| ServeError::Taken { path: path.display().to_string(), what };
    match std::fs::symlink_metadata(path) {
        Err(_absent) => Ok(()),
        Ok(there) if !there.file_type().is_socket() => Err(taken("not a socket")),
        Ok(_) if UnixStream::connect(path).is_ok() => Err(taken("a socket in use")),
        Ok(_) => std::fs::remove_file(path).map_err(ServeError::system("replace", path)),
    }
}
