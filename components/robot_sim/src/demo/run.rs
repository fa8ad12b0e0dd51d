//! One run: simulator and daemon up, watch until the robot arrives, both down.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use super::DemoError;
use super::process::Process;
use super::profile::{self, Changes};
use super::progress::Progress;
use super::report::Report;
use super::schedule::Injection;
use super::steering;
use super::watch::Watch;
use crate::serve::mono_ns;

const SIMULATOR_PATIENCE: Duration = Duration::from_secs(5);
const DAEMON_PATIENCE: Duration = Duration::from_secs(20);
/// The simulator goes on playing the board for this long while the daemon ends: a board that vanishes first would be
/// one more fault, and not one of the demo's.
const LINGER_S: &str = "30";

/// What to run.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The profile directory to copy.
    pub profile: PathBuf,
    /// Where everything that the run leaves behind goes.
    pub out: PathBuf,
    /// The daemon's program.
    pub daemon: PathBuf,
    /// The simulator's program.
    pub simulator: PathBuf,
    /// Directories with plugins.
    pub plugins: Vec<PathBuf>,
    /// Faults to inject.
    pub schedule: Vec<Injection>,
    /// World file, if not the simulator's own.
    pub world: Option<PathBuf>,
    /// Seed of the simulator's noise.
    pub seed: u64,
    /// Give up this long after the daemon is ready.
    pub timeout: Duration,
    /// `preload` of the secondary, if not as the profile says.
    pub preload: Option<String>,
}

/// Runs the demo once. Everything that was started has ended when this returns, whatever it returns.
///
/// # Errors
/// The run could not be carried through, or `stop` was set by a signal.
pub fn run(settings: &Settings, stop: &AtomicBool, progress: &mut Progress) -> Result<Report, DemoError> {
    std::fs::create_dir_all(&settings.out).map_err(DemoError::system("make", &settings.out))?;
    let place = Place::new(&settings.out)?;
    let changes = Changes { device: &place.board(), socket: &place.camera(), preload: settings.preload.as_deref() };
    profile::copy(&settings.profile, &place.profile(), changes)?;
    let mut simulator = start_simulator(settings, &place)?;
    let mut daemon = start_daemon(settings, &place)?;
    let ready_ns = mono_ns();
    progress.say("  daemon ready, robot under way");
    let mut watch = Watch::new(&place.record(), &place.journal(), ready_ns);
    let mut complaints = watch.until_over(settings.timeout, stop, progress, (&mut simulator, &mut daemon))?;
    let ended = end_daemon(&mut daemon);
    // If it has died on the way, that is told already.
    complaints.extend(ended.filter(|_| complaints.is_empty()));
    simulator.end();
    watch.look(progress);
    progress.clear();
    watch.report(&settings.schedule, steering::read(&place.daemon_log()), complaints)
}

/// Where the files of a run are.
struct Place {
    out: PathBuf,
    /// Device link and socket live here: a socket's path may have 107 bytes, which the output directory may exceed.
    short: PathBuf,
}

impl Place {
    fn new(out: &Path) -> Result<Self, DemoError> {
        let short = std::env::temp_dir().join(format!("robot-demo-{}", std::process::id()));
        std::fs::create_dir_all(&short).map_err(DemoError::system("make", &short))?;
        let place = Self { out: out.to_owned(), short };
        for old in [place.journal(), place.record()] {
            // An old journal would be read as this run's.
            let _absent = std::fs::remove_file(old);
        }
        Ok(place)
    }

    fn board(&self) -> PathBuf {
        self.short.join("board")
    }

    fn camera(&self) -> PathBuf {
        self.short.join("camera")
    }

    fn profile(&self) -> PathBuf {
        self.out.join("profile")
    }

    fn journal(&self) -> PathBuf {
        self.out.join("journal.jsonl")
    }

    fn daemon_log(&self) -> PathBuf {
        self.out.join("daemon.log")
    }

    fn record(&self) -> PathBuf {
        self.out.join("record.jsonl")
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _gone_already = std::fs::remove_dir_all(&self.short);
    }
}

fn program(path: &Path) -> Result<Command, DemoError> {
    if path.is_file() { Ok(Command::new(path)) } else { Err(DemoError::Missing(path.to_owned())) }
}

fn start_simulator(settings: &Settings, place: &Place) -> Result<Process, DemoError> {
    let mut command = program(&settings.simulator)?;
    command.arg("--board").arg(place.board()).arg("--camera").arg(place.camera());
    command.arg("--record").arg(place.record()).args(["--seed", &settings.seed.to_string(), "--linger", LINGER_S]);
    let limit = (settings.timeout + DAEMON_PATIENCE + SIMULATOR_PATIENCE).as_secs_f64();
    command.args(["--timeout", &limit.to_string()]);
    if let Some(world) = &settings.world {
        command.arg("--world").arg(world);
    }
    let mut process = Process::start("the simulator", command, &place.out.join("simulator.log"))?;
    process.wait_ready(SIMULATOR_PATIENCE)?;
    Ok(process)
}

fn start_daemon(settings: &Settings, place: &Place) -> Result<Process, DemoError> {
    let mut command = program(&settings.daemon)?;
    command.arg("run").arg(place.profile()).arg("--journal").arg(place.journal());
    for directory in &settings.plugins {
        command.arg("--plugins").arg(directory);
    }
    for injection in &settings.schedule {
        command.args(["--inject", &injection.to_string()]);
    }
    let mut process = Process::start("the daemon", command, &place.daemon_log())?;
    process.wait_ready(DAEMON_PATIENCE)?;
    Ok(process)
}

fn end_daemon(daemon: &mut Process) -> Option<String> {
    match daemon.end() {
        Some(status) if status.success() => None,
        Some(status) => Some(format!("the daemon ended with {status}; its last words:\n{}", daemon.last_words())),
        None => Some("the daemon did not end after SIGTERM and was killed".into()),
    }
}
