//! What a run needs: the programs, a copy of the profile, a place for files, somebody who writes down what passes a port.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use robot_sim::demo::process::Process;
use serde_json::Value;
use tempfile::TempDir;

use super::{FRONT_LEFT, POWER_OFF, Sample};

/// Why there is no run, in words.
pub type Failure = Box<dyn std::error::Error>;

/// What the profile says, and what the experiment needs instead: one window after the other; a fault that is only told, so that
/// the curves go on behind it; a robot that stands until everything is recorded.
const WINDOW: &str = "window=\"400ms\"";
const STOP: &str = "<severity symptom=\"model\">stop</severity>";
const IGNORE: &str = "<severity symptom=\"model\">ignore</severity>";
const BOARD: &str = "/tmp/robot-board";
const COURSE: &str = "<source component_name=\"planner\" port_name=\"course\"/>";
const CONNECTION: &str = "<port_connection port_type=\"data\">";
const CONNECTION_END: &str = "</port_connection>";

/// Where the programs are.
#[derive(Clone, Debug)]
pub struct Programs {
    directory: PathBuf,
}

impl Programs {
    /// Those that were built beside this program: a test or an example.
    ///
    /// # Errors
    /// They are not built.
    pub fn beside_this() -> Result<Self, Failure> {
        let this = std::env::current_exe()?;
        let directory = this.ancestors().nth(2).unwrap_or(Path::new("")).to_owned();
        for program in ["framework-daemon", "robot-sim", "libencoder_model.so"] {
            if !directory.join(program).is_file() {
                return Err(format!("{program} is not in {}; build the workspace first", directory.display()).into());
            }
        }
        Ok(Self { directory })
    }

    fn command(&self, program: &str) -> Command {
        Command::new(self.directory.join(program))
    }
}

/// The files and processes of a run; whatever becomes of it, they are gone afterwards.
pub(super) struct Stage<'a> {
    programs: &'a Programs,
    files: TempDir,
}

impl<'a> Stage<'a> {
    /// Copies the profile, with a window of that length.
    pub(super) fn set(programs: &'a Programs, window_ms: u64) -> Result<Self, Failure> {
        let stage = Self { programs, files: TempDir::new()? };
        let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../profiles/encoder_monitor");
        std::fs::create_dir(stage.file("profile"))?;
        for file in std::fs::read_dir(original)? {
            let (from, name) = file.map(|file| (file.path(), file.file_name()))?;
            let mut text = std::fs::read_to_string(&from)?;
            if name == "encoder_monitor.xml" {
                text = changed(&text, &stage.file("board"), window_ms)?;
            }
            std::fs::write(stage.file("profile").join(name), text)?;
        }
        Ok(stage)
    }

    /// A file of this run.
    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.files.path().join(name)
    }

    /// The robot, whose left wheels lose their power.
    pub(super) fn simulator(&self) -> Result<Process, Failure> {
        let mut command = self.programs.command("robot-sim");
        command.arg("--board").arg(self.file("board")).arg("--record").arg(self.file("record.jsonl"));
        command.args(["--timeout", "1000", "--linger", "1000", "--left-power-off", &POWER_OFF.to_string()]);
        Ok(Process::start("the simulator", command, &self.file("simulator.log"))?)
    }

    /// The daemon.
    pub(super) fn daemon(&self) -> Result<Process, Failure> {
        let mut command = self.programs.command("framework-daemon");
        command.arg("run").arg(self.file("profile")).arg("--plugins").arg(&self.programs.directory);
        command.arg("--journal").arg(self.file("journal.jsonl")).arg("--socket").arg(self.file("control.sock"));
        Ok(Process::start("the daemon", command, &self.file("daemon.log"))?)
    }

    /// Writes down what passes a port.
    pub(super) fn listen(&self, port: &'static str) -> Result<Ear, Failure> {
        let mut command = self.verb(&["port", "echo", port, "--format", "json"]);
        let path = self.file(port);
        let child = command.stdout(File::create(&path)?).spawn()?;
        Ok(Ear { child, port, path })
    }

    /// Lets the planner drive.
    pub(super) fn release(&self) -> Result<(), Failure> {
        let output = self.verb(&["connect", "planner.course", "motors.command"]).output()?;
        if output.status.success() { Ok(()) } else { Err(String::from_utf8_lossy(&output.stderr).into()) }
    }

    fn verb(&self, words: &[&str]) -> Command {
        let mut command = self.programs.command("framework-daemon");
        command.args(words).arg("--socket").arg(self.file("control.sock")).stdin(Stdio::null());
        command
    }
}

fn changed(text: &str, board: &Path, window_ms: u64) -> Result<String, Failure> {
    let mut text = text.to_owned();
    let window = format!("window=\"{window_ms}ms\"");
    for (from, to) in [(WINDOW, window.as_str()), (STOP, IGNORE), (BOARD, &board.to_string_lossy())] {
        if !text.contains(from) {
            return Err(format!("the profile does not say {from}").into());
        }
        text = text.replace(from, to);
    }
    let course = text.find(COURSE).ok_or("the profile does not connect the planner")?;
    let begin = text[..course].rfind(CONNECTION).ok_or("the planner's course is no connection")?;
    let end = text[course..].find(CONNECTION_END).ok_or("the planner's connection has no end")? + course;
    text.replace_range(begin..end + CONNECTION_END.len(), "");
    Ok(text)
}

/// Somebody who writes down what passes a port.
pub(super) struct Ear {
    child: Child,
    port: &'static str,
    path: PathBuf,
}

impl Ear {
    /// What passed so far.
    pub(super) fn heard(&self) -> Result<Vec<Sample>, Failure> {
        let text = std::fs::read_to_string(&self.path)?;
        let complete = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
        complete.map(|line| sample(line).ok_or_else(|| format!("{} said {line}", self.port).into())).collect()
    }

    /// All that passed.
    pub(super) fn end(self) -> Result<Vec<Sample>, Failure> {
        self.heard()
    }
}

impl Drop for Ear {
    fn drop(&mut self) {
        let _gone_already = self.child.kill();
        let _gone_already = self.child.wait();
    }
}

/// `None`: no sample, or one before which others were passed over while the wheel turned; at rest they were all the same.
fn sample(line: &str) -> Option<Sample> {
    let line: Value = serde_json::from_str(line).ok()?;
    let echo = line.get("echo")?;
    let (stamp, ticks) = (&echo["value"]["stamp"], &echo["value"]["ticks"][FRONT_LEFT]);
    let ticks = ticks.as_i64()?.try_into().ok()?;
    (echo["missed"] == 0 || ticks == 0).then_some(())?;
    let measured = stamp["sec"].as_f64()? + stamp["nanosec"].as_f64()? * 1e-9;
    Some(Sample { at_ns: echo["stamp_ns"].as_u64()?, measured, ticks })
}
