//! Processes that the demo starts and, come what may, ends.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use super::DemoError;

/// How long a process may take to end after SIGTERM before it is killed.
const GRACE: Duration = Duration::from_secs(5);
const LOOK_AGAIN: Duration = Duration::from_millis(10);
/// How much of a log an error shows.
const LAST_WORDS_BYTES: usize = 2000;

/// A running process. Dropping it ends it: by SIGTERM, and if that does not help, by force.
pub struct Process {
    name: &'static str,
    child: Child,
    lines: Receiver<String>,
    log: PathBuf,
}

impl Process {
    /// Starts `command`; its standard error goes to the file `log`.
    ///
    /// # Errors
    /// The program or the log file cannot be opened.
    pub fn start(name: &'static str, mut command: Command, log: &Path) -> Result<Self, DemoError> {
        let program = PathBuf::from(command.get_program());
        let errors = File::create(log).map_err(DemoError::system("write", log))?;
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(errors)
            .spawn()
            .map_err(DemoError::system("start", &program))?;
        let (sender, lines) = channel();
        let output = child.stdout.take();
        // Reads on to the end, so that the process never blocks on a full pipe.
        std::thread::spawn(move || {
            let lines = output.into_iter().flat_map(|output| BufReader::new(output).lines()).map_while(Result::ok);
            lines.for_each(|line| drop(sender.send(line)));
        });
        Ok(Self { name, child, lines, log: log.to_owned() })
    }

    /// Waits for the line that begins with `ready`.
    ///
    /// # Errors
    /// The process ends, or says nothing of the kind for `patience`.
    pub fn wait_ready(&mut self, patience: Duration) -> Result<(), DemoError> {
        let end = Instant::now() + patience;
        loop {
            match self.lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
                Ok(line) if line.starts_with("ready") => return Ok(()),
                Ok(_other) => {}
                Err(_) if Instant::now() < end => {
                    let how = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
                    return Err(self.not_ready(format!("ended before it was ready ({how})")));
                }
                Err(_) => return Err(self.not_ready(format!("was not ready after {} s", patience.as_secs()))),
            }
        }
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Ends it and says how it went; `None` if it had to be killed.
    pub fn end(&mut self) -> Option<ExitStatus> {
        if let Some(status) = self.ended() {
            return Some(status);
        }
        // An error means that it is gone already.
        let _gone = kill_process(Pid::from_child(&self.child), Signal::TERM);
        let end = Instant::now() + GRACE;
        while Instant::now() < end {
            if let Some(status) = self.ended() {
                return Some(status);
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        let _gone = self.child.kill();
        let _gone = self.child.wait();
        None
    }

    /// The end of its log.
    #[must_use]
    pub fn last_words(&self) -> String {
        let mut text = Vec::new();
        let _unreadable = File::open(&self.log).and_then(|mut file| file.read_to_end(&mut text));
        String::from_utf8_lossy(&text[text.len().saturating_sub(LAST_WORDS_BYTES)..]).trim_end().to_owned()
    }

    fn not_ready(&self, what: String) -> DemoError {
        DemoError::NotReady { program: self.name, what, words: self.last_words() }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}
