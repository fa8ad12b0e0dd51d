//! Clients of a daemon's control socket: the command line, and raw bytes.

use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use serde_json::{Value, json};

use crate::daemon_binary::daemon_binary;
use crate::running::Running;

/// Far beyond what any answer needs.
const PATIENCE: Duration = Duration::from_secs(60);

/// How a verb ended.
#[derive(Debug)]
pub struct Answer {
    /// Exit code.
    pub code: Option<i32>,
    /// What it printed.
    pub out: String,
    /// What it said is wrong.
    pub err: String,
}

impl Answer {
    /// Each line as JSON.
    ///
    /// # Panics
    /// When one is none.
    #[must_use]
    pub fn json(&self) -> Vec<Value> {
        let parse = |line: &str| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        self.out.lines().map(parse).collect()
    }
}

/// A verb, asked of the daemon behind that socket.
#[must_use]
pub fn verb(socket: &Path, words: &str) -> Command {
    let mut command = Command::new(daemon_binary());
    command.args(words.split_whitespace()).arg("--socket").arg(socket).stdin(Stdio::null());
    command
}

/// Asks a verb that ends by itself.
///
/// # Panics
/// When the binary cannot be started.
#[must_use]
pub fn ask(daemon: &Running, words: &str) -> Answer {
    ask_at(daemon.socket(), words)
}

/// As [`ask`], at a socket.
///
/// # Panics
/// As there.
#[must_use]
pub fn ask_at(socket: &Path, words: &str) -> Answer {
    answer(&verb(socket, words).output().expect("the daemon's binary runs"))
}

/// Checks a profile directory.
///
/// # Panics
/// When the binary cannot be started.
#[must_use]
pub fn check(profiles: &Path) -> Answer {
    answer(&Command::new(daemon_binary()).arg("check").arg(profiles).output().expect("the daemon's binary runs"))
}

/// Draws a profile directory.
///
/// # Panics
/// When the binary cannot be started.
#[must_use]
pub fn graph(profiles: &Path, kind: &str) -> Answer {
    let mut command = Command::new(daemon_binary());
    answer(&command.arg("graph").arg(profiles).args(["--as", kind]).output().expect("the daemon's binary runs"))
}

/// Starts a verb that goes on.
///
/// # Panics
/// When the binary cannot be started.
#[must_use]
pub fn start(daemon: &Running, words: &str) -> Child {
    let mut command = verb(daemon.socket(), words);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the daemon's binary runs")
}

/// How a verb that was started ended.
///
/// # Panics
/// When it cannot be waited for.
#[must_use]
pub fn finish(child: Child) -> Answer {
    answer(&child.wait_with_output().expect("a child can be waited for"))
}

fn answer(output: &Output) -> Answer {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Answer { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
}

/// A client that speaks the wire form by itself.
#[derive(Debug)]
pub struct Wire(pub UnixStream);

impl Wire {
    /// Connects.
    ///
    /// # Panics
    /// When nobody listens.
    #[must_use]
    pub fn to(daemon: &Running) -> Self {
        let stream = UnixStream::connect(daemon.socket()).expect("the daemon listens");
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket has a timeout");
        Self(stream)
    }

    /// Sends bytes; false: the daemon hung up.
    pub fn send(&mut self, bytes: &[u8]) -> bool {
        self.0.write_all(bytes).is_ok()
    }

    /// Calls a method of the daemon's own interface.
    ///
    /// # Panics
    /// When the daemon hung up.
    pub fn call(&mut self, method: &str, parameters: &Value, more: bool) {
        let call = json!({"method": format!("io.frameworkdaemon.{method}"), "parameters": parameters, "more": more});
        assert!(self.send(format!("{call}\0").as_bytes()), "the daemon hung up");
    }

    /// The next reply; `None`: the daemon hung up.
    ///
    /// # Panics
    /// When nothing comes, or no JSON.
    pub fn reply(&mut self) -> Option<Value> {
        let (mut bytes, mut byte) = (Vec::new(), [0]);
        loop {
            match self.0.read(&mut byte) {
                Ok(1) if byte[0] == 0 => return Some(serde_json::from_slice(&bytes).expect("a reply is JSON")),
                Ok(1) => bytes.push(byte[0]),
                Ok(_) => return None,
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => return None,
                Err(error) => panic!("no reply: {error}"),
            }
        }
    }

    /// Calls and waits for the first reply.
    ///
    /// # Panics
    /// When there is none.
    pub fn ask(&mut self, method: &str, parameters: &Value) -> Value {
        self.call(method, parameters, false);
        self.reply().expect("the daemon answers")
    }
}
