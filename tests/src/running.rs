//! A daemon that runs. Every wait has a deadline far beyond what is needed: a test fails by it, it never measures with it.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use framework_daemon::fault::journal::unseal;
use serde_json::Value;
use tempfile::TempDir;

use crate::daemon_binary::daemon_binary;
use crate::profiles::plugin_dir;

/// Far beyond what anything here needs.
const PATIENCE: Duration = Duration::from_secs(60);

/// A daemon, ended when the test ends.
pub struct Running {
    child: Child,
    log: Arc<Mutex<String>>,
    journal: PathBuf,
    socket: PathBuf,
    _scratch: TempDir,
}

impl Running {
    /// Runs a profile directory with the plugins of this build and waits until it is ready.
    ///
    /// # Panics
    /// When it does not get ready.
    #[must_use]
    pub fn start(directory: &Path, arguments: &[&str]) -> Self {
        Self::spawn(directory, arguments).ready()
    }

    /// As [`Self::start`], without a log: for runs that would fill it.
    ///
    /// # Panics
    /// When it does not get ready.
    #[must_use]
    pub fn start_silent(directory: &Path) -> Self {
        Self::spawn_with(directory, &[], "off").ready()
    }

    /// Waits until it is ready.
    ///
    /// # Panics
    /// When it does not get ready.
    #[must_use]
    pub fn ready(mut self) -> Self {
        while !self.log().contains("ready: ") {
            assert!(self.is_alive(), "it ended before it was ready; the log:\n{}", self.log());
            thread::sleep(Duration::from_millis(5));
        }
        self
    }

    /// Runs a profile directory without waiting.
    ///
    /// # Panics
    /// When the binary cannot be started.
    #[must_use]
    pub fn spawn(directory: &Path, arguments: &[&str]) -> Self {
        Self::spawn_with(directory, arguments, "info")
    }

    fn spawn_with(directory: &Path, arguments: &[&str], log: &str) -> Self {
        let scratch = scratch();
        Self::launch(&scratch.path().join("journal.jsonl"), directory, arguments, log, scratch)
    }

    /// As [`Self::spawn`], on a journal that others wrote into.
    ///
    /// # Panics
    /// When the binary cannot be started.
    #[must_use]
    pub fn spawn_on(journal: &Path, directory: &Path, arguments: &[&str]) -> Self {
        Self::launch(journal, directory, arguments, "info", scratch())
    }

    /// As [`Self::start`], without saying where the control socket is: a user's, whose runtime directory this is.
    ///
    /// # Panics
    /// When it does not get ready.
    #[must_use]
    pub fn start_at_home(directory: &Path, runtime: &Path) -> Self {
        let scratch = scratch();
        let journal = scratch.path().join("journal.jsonl");
        let mut command = command(&journal, directory, &[], "info");
        command.env("XDG_RUNTIME_DIR", runtime);
        let socket = runtime.join("framework-daemon/control.sock");
        Self::begin(command, journal, socket, scratch).ready()
    }

    fn launch(journal: &Path, directory: &Path, arguments: &[&str], log: &str, scratch: TempDir) -> Self {
        let socket = scratch.path().join("control.sock");
        let mut command = command(journal, directory, arguments, log);
        // Many daemons run at once: each has a socket of its own, where a test does not say otherwise.
        if !arguments.contains(&"--socket") {
            command.arg("--socket").arg(&socket);
        }
        Self::begin(command, journal.to_owned(), socket, scratch)
    }

    fn begin(mut command: Command, journal: PathBuf, socket: PathBuf, scratch: TempDir) -> Self {
        let mut child = command.spawn().expect("the daemon's binary runs");
        let log = Arc::new(Mutex::new(String::new()));
        collect(child.stdout.take().expect("stdout is piped"), &log);
        collect(child.stderr.take().expect("stderr is piped"), &log);
        Self { child, log, journal, socket, _scratch: scratch }
    }

    /// Its process number.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Where its journal is.
    #[must_use]
    pub fn journal_file(&self) -> &Path {
        &self.journal
    }

    /// Where its control socket is.
    #[must_use]
    pub fn socket(&self) -> &Path {
        &self.socket
    }

    /// All that it printed so far, stdout and stderr.
    ///
    /// # Panics
    /// Never, unless a collecting thread did.
    #[must_use]
    pub fn log(&self) -> String {
        self.log.lock().expect("no collector panics").clone()
    }

    /// Waits until it printed `text`.
    ///
    /// # Panics
    /// When it does not.
    pub fn wait_for(&self, text: &str) {
        self.until(&format!("`{text}` in the log"), || self.log().contains(text));
    }

    /// Waits until `count` lines of the log contain `text`.
    ///
    /// # Panics
    /// When they do not.
    pub fn wait_for_lines(&self, text: &str, count: usize) {
        self.until(&format!("{count} lines with `{text}`"), || self.lines(text).len() >= count);
    }

    /// The log's lines that contain `text`.
    #[must_use]
    pub fn lines(&self, text: &str) -> Vec<String> {
        self.log().lines().filter(|line| line.contains(text)).map(str::to_owned).collect()
    }

    /// Waits until the journal has `count` entries of that kind, and returns them.
    ///
    /// # Panics
    /// When it has not.
    #[must_use]
    pub fn journal(&self, kind: &str, count: usize) -> Vec<Value> {
        self.until(&format!("{count} `{kind}` in the journal"), || self.entries(kind).len() >= count);
        self.entries(kind)
    }

    /// The journal's entries of that kind; every complete line must have a right checksum.
    ///
    /// # Panics
    /// When one has not.
    #[must_use]
    pub fn entries(&self, kind: &str) -> Vec<Value> {
        let text = std::fs::read_to_string(&self.journal).unwrap_or_default();
        let complete = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
        let entries = complete.map(|line| unseal(line).unwrap_or_else(|| panic!("damaged journal line: {line}")));
        entries.filter(|entry| entry["kind"] == kind).collect()
    }

    /// Waits until `test` is true; `what` is what was waited for.
    ///
    /// # Panics
    /// When it does not become so.
    pub fn until(&self, what: &str, test: impl Fn() -> bool) {
        let began = Instant::now();
        while !test() {
            assert!(began.elapsed() < PATIENCE, "waited for {what}; the log:\n{}", self.log());
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Its process.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Sends a signal: `HUP`, `TERM`, `INT`.
    ///
    /// # Panics
    /// When it cannot be sent.
    pub fn signal(&self, name: &str) {
        let status = Command::new("kill").arg(format!("-{name}")).arg(self.child.id().to_string()).status();
        assert!(status.expect("kill runs").success());
    }

    /// Waits for its end.
    ///
    /// # Panics
    /// When it does not end.
    pub fn wait(&mut self) -> ExitStatus {
        let began = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child can be waited for") {
                return status;
            }
            assert!(began.elapsed() < PATIENCE, "waited for the end; the log:\n{}", self.log());
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Ends it in order; returns what the journal says of each slot.
    ///
    /// # Panics
    /// When it does not end well.
    pub fn stop(&mut self) -> Vec<Value> {
        self.signal("TERM");
        let status = self.wait();
        assert!(status.success(), "{status}; the log:\n{}", self.log());
        let stops = self.entries("stop");
        stops[0]["slots"].as_array().cloned().unwrap_or_default()
    }

    /// Ends it in order, like [`Self::stop`].
    ///
    /// # Errors
    /// In words, when it had ended before or does not end well.
    ///
    /// # Panics
    /// When it cannot be asked.
    pub fn end(&mut self) -> Result<Vec<Value>, String> {
        if !self.is_alive() {
            return Err(format!("the daemon died: {}", self.wait()));
        }
        self.signal("TERM");
        let began = Instant::now();
        while self.is_alive() {
            if began.elapsed() > PATIENCE {
                return Err("the daemon does not end".to_owned());
            }
            thread::sleep(Duration::from_millis(5));
        }
        let status = self.wait();
        let stops = self.entries("stop");
        let slots = stops.first().and_then(|stop| stop["slots"].as_array().cloned());
        slots.filter(|_| status.success()).ok_or_else(|| format!("the daemon did not end well: {status}"))
    }

    /// True while it runs.
    ///
    /// # Panics
    /// Never in practice.
    pub fn is_alive(&mut self) -> bool {
        self.child.try_wait().expect("a child can be waited for").is_none()
    }
}

fn command(journal: &Path, directory: &Path, arguments: &[&str], log: &str) -> Command {
    let mut command = Command::new(daemon_binary());
    command.arg("run").arg(directory).args(["--plugins".as_ref(), plugin_dir().as_os_str()]);
    command.args(["--journal".as_ref(), journal.as_os_str()]).args(arguments).env("RUST_LOG", log);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn scratch() -> TempDir {
    TempDir::new().expect("a temporary directory")
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn collect(stream: impl Read + Send + 'static, log: &Arc<Mutex<String>>) {
    let log = Arc::clone(log);
    thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            let mut log = log.lock().expect("no collector panics");
            log.push_str(&line);
            log.push('\n');
        }
    });
}
