//! The command line's side: connects, asks, reads answers.

use std::io::{self, Read, Write};
use std::ops::ControlFlow;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use serde_json::{Map, Value};

use super::interface::OWN;
use super::socket;
use super::wire::{Call, Inbox};
use crate::model::limits::{CONTROL_ANSWER, CONTROL_REPLY_BYTES};

/// Why there is no answer.
#[derive(Debug)]
pub enum CallError {
    /// There is no daemon, or it does not answer.
    Unreachable(String),
    /// It refused.
    Refused {
        /// The error's name.
        name: String,
        /// Its parameters.
        parameters: Value,
    },
}

/// A connection to a daemon.
#[derive(Debug)]
pub struct Client {
    stream: UnixStream,
    path: PathBuf,
    inbox: Inbox,
}

/// A reply, and whether more of them come.
struct Reply {
    parameters: Value,
    continues: bool,
}

impl Client {
    /// Connects to the socket at `path`, or to the first of the usual places where a daemon listens.
    ///
    /// # Errors
    /// When there is none, with the way out.
    pub fn connect(path: Option<&Path>) -> Result<Self, CallError> {
        let places = path.map_or_else(socket::places, |path| vec![path.to_owned()]);
        let mut tried = Vec::new();
        for path in places {
            match UnixStream::connect(&path) {
                Ok(stream) => return Ok(Self { stream, path, inbox: Inbox::new(CONTROL_REPLY_BYTES) }),
                Err(error) => tried.push(format!("{}: {}", path.display(), why(&error))),
            }
        }
        Err(CallError::Unreachable(format!(
            "no daemon can be reached ({}); start one by `framework-daemon run DIR`, or say where it listens by --socket PATH",
            tried.join("; ")
        )))
    }

    /// Calls a method of the daemon's own interface that answers at once.
    ///
    /// # Errors
    /// When there is no answer.
    pub fn call(&mut self, method: &str, parameters: Map<String, Value>) -> Result<Value, CallError> {
        self.send(method, parameters, false)?;
        self.receive(Some(CONTROL_ANSWER)).map(|reply| reply.parameters)
    }

    /// As [`Self::call`], for a method that takes its time.
    ///
    /// # Errors
    /// As there.
    pub fn call_patiently(&mut self, method: &str, parameters: Map<String, Value>) -> Result<Value, CallError> {
        self.send(method, parameters, false)?;
        self.receive(None).map(|reply| reply.parameters)
    }

    /// Calls a method that answers again and again, until `each` has seen enough, or nobody reads any more what is written to
    /// `output`: nothing may come for a long time, and who left does not wait for it.
    ///
    /// # Errors
    /// When there is no answer, or no more.
    pub fn stream(
        &mut self,
        method: &str,
        parameters: Map<String, Value>,
        output: BorrowedFd<'_>,
        mut each: impl FnMut(&Value) -> ControlFlow<()>,
    ) -> Result<(), CallError> {
        self.send(method, parameters, true)?;
        loop {
            if !self.inbox.has_message() && !self.comes_before_end_of(output) {
                return Ok(());
            }
            let reply = self.receive(None)?;
            if each(&reply.parameters).is_break() || !reply.continues {
                return Ok(());
            }
        }
    }

    fn send(&mut self, method: &str, parameters: Map<String, Value>, more: bool) -> Result<(), CallError> {
        let call = Call { method: format!("{OWN}.{method}"), parameters, more, oneway: false };
        match self.stream.write_all(&call.to_bytes()) {
            // Who refuses a client says why before it hangs up.
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(self.lost(&error.to_string())),
            _ => Ok(()),
        }
    }

    fn receive(&mut self, limit: Option<Duration>) -> Result<Reply, CallError> {
        let limited = self.stream.set_read_timeout(limit);
        limited.map_err(|error| self.lost(&error.to_string()))?;
        let mut chunk = [0; 64 << 10];
        loop {
            let message = self.inbox.take().map_err(|_| self.lost("its answer is too long"))?;
            if let Some(message) = message {
                return read_reply(&message).unwrap_or_else(|| Err(self.lost("it does not speak varlink")));
            }
            match self.stream.read(&mut chunk) {
                Ok(0) => return Err(self.lost("it hung up")),
                Ok(count) => self.inbox.put(chunk.get(..count).unwrap_or_default()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    return Err(self.lost(&format!("no answer within {CONTROL_ANSWER:?}")));
                }
                Err(error) if error.kind() == io::ErrorKind::ConnectionReset => return Err(self.lost("it hung up")),
                Err(error) => return Err(self.lost(&error.to_string())),
            }
        }
    }

    /// Waits for more of an answer; false: nobody reads `output` any more.
    fn comes_before_end_of(&self, output: BorrowedFd<'_>) -> bool {
        let gone = PollFlags::POLLERR | PollFlags::POLLHUP | PollFlags::POLLNVAL;
        loop {
            let mut fds =
                [PollFd::new(self.stream.as_fd(), PollFlags::POLLIN), PollFd::new(output, PollFlags::empty())];
            // What cannot be waited for is read, and waited for there.
            if poll(&mut fds, PollTimeout::NONE).is_err_and(|error| error != nix::errno::Errno::EINTR) {
                return true;
            }
            let [comes, ends] = fds.map(|fd| fd.revents().unwrap_or(PollFlags::empty()));
            if !comes.is_empty() || ends.intersects(gone) {
                return !comes.is_empty();
            }
        }
    }

    fn lost(&self, reason: &str) -> CallError {
        CallError::Unreachable(format!("the daemon at {}: {reason}", self.path.display()))
    }
}

fn why(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::ConnectionRefused => "nobody listens any more".to_owned(),
        io::ErrorKind::NotFound => "no such socket".to_owned(),
        io::ErrorKind::PermissionDenied => {
            "you may not use it: run as root, or as the daemon's user or group".to_owned()
        }
        _ => error.to_string(),
    }
}

/// Takes a reply apart; `None`: it is none.
fn read_reply(message: &[u8]) -> Option<Result<Reply, CallError>> {
    let Value::Object(mut fields) = serde_json::from_slice(message).ok()? else { return None };
    let parameters = fields.remove("parameters").unwrap_or_default();
    Some(match fields.remove("error") {
        Some(Value::String(name)) => Err(CallError::Refused { name, parameters }),
        Some(_) => return None,
        None => Ok(Reply { parameters, continues: fields.remove("continues") == Some(Value::Bool(true)) }),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn where_nobody_listens_the_way_out_is_told() {
        let Err(CallError::Unreachable(told)) = Client::connect(Some(Path::new("/nowhere/control.sock"))) else {
            panic!("somebody listens at /nowhere")
        };
        assert!(told.contains("/nowhere/control.sock: no such socket") && told.contains("--socket PATH"), "{told}");
    }

    proptest! {
        #[test]
        fn no_reply_is_too_wild(bytes in prop::collection::vec(any::<u8>(), 0..100)) {
            let _ = read_reply(&bytes);
        }
    }
}
