//! One run: simulator and daemon up, watch until the robot arrives, both down.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::DemoError;
use super::follow::Follower;
use super::journal::{Fault, merge};
use super::process::Process;
use super::profile::{self, Changes};
use super::progress::{Progress, Standing};
use super::report::Report;
use super::schedule::Injection;
use crate::serve::mono_ns;
use crate::serve::record::{End, Moment, Record};
use crate::world::World;

const SIMULATOR_PATIENCE: Duration = Duration::from_secs(5);
const DAEMON_PATIENCE: Duration = Duration::from_secs(20);
const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// After the arrival, so that the journal can complete its last entry before the daemon is asked to end.
const SETTLE: Duration = Duration::from_millis(300);
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
    let mut watch = Watch::new(&place, ready_ns);
    let mut complaints = watch.until_over(settings, stop, progress, &mut simulator, &mut daemon)?;
    watch.over_ns = mono_ns();
    complaints.extend(end_daemon(&mut daemon));
    simulator.end();
    watch.look(progress);
    progress.clear();
    watch.report(settings, complaints)
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
    let mut process = Process::start("the daemon", command, &place.out.join("daemon.log"))?;
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

/// What has been seen so far.
struct Watch {
    records: Follower,
    journal: Follower,
    world: Option<World>,
    track: Vec<Moment>,
    end: Option<End>,
    faults: Vec<Fault>,
    told: usize,
    ready_ns: u64,
    over_ns: u64,
}

impl Watch {
    fn new(place: &Place, ready_ns: u64) -> Self {
        Self {
            records: Follower::new(&place.record()),
            journal: Follower::new(&place.journal()),
            world: None,
            track: Vec::new(),
            end: None,
            faults: Vec::new(),
            told: 0,
            ready_ns,
            over_ns: ready_ns,
        }
    }

    /// Watches until the robot arrives, time is up or a process ends; returns complaints.
    fn until_over(
        &mut self,
        settings: &Settings,
        stop: &AtomicBool,
        progress: &mut Progress,
        simulator: &mut Process,
        daemon: &mut Process,
    ) -> Result<Vec<String>, DemoError> {
        let begin = Instant::now();
        loop {
            self.look(progress);
            progress.show(self.standing());
            if stop.load(Ordering::Relaxed) {
                return Err(DemoError::Interrupted);
            }
            if self.end.is_some() {
                std::thread::sleep(SETTLE);
                return Ok(Vec::new());
            }
            if let Some(status) = daemon.ended() {
                return Ok(vec![format!("the daemon ended on the way ({status})")]);
            }
            if let Some(status) = simulator.ended() {
                return Ok(vec![format!("the simulator ended on the way ({status}): {}", simulator.last_words())]);
            }
            if begin.elapsed() > settings.timeout {
                return Ok(vec![format!("not there after {} s", settings.timeout.as_secs())]);
            }
            std::thread::sleep(LOOK_PERIOD);
        }
    }

    fn look(&mut self, progress: &mut Progress) {
        for record in self.records.look::<Record>() {
            match record {
                Record::Start { world, .. } => self.world = Some(world),
                Record::Truth(moment) => self.track.push(moment),
                Record::End(end) => self.end = Some(end),
            }
        }
        merge(&mut self.faults, self.journal.look());
        for fault in &self.faults[self.told..] {
            progress.fault((fault.mono_ns as f64 - self.ready_ns as f64) / 1e9, fault);
        }
        self.told = self.faults.len();
    }

    fn standing(&self) -> Standing {
        Standing {
            seconds: mono_ns().saturating_sub(self.ready_ns) as f64 / 1e9,
            moment: self.track.last().copied(),
            start_m: self.track.first().map_or(0.0, |moment| moment.target_m),
            faults: self.faults.iter().filter(|fault| !fault.ignored()).count(),
            recovered: self.faults.iter().filter(|fault| fault.recovered()).count(),
        }
    }

    fn report(mut self, settings: &Settings, complaints: Vec<String>) -> Result<Report, DemoError> {
        // What the daemon reports while it is being ended is about the end, not about the run.
        self.faults.retain(|fault| fault.mono_ns <= self.over_ns);
        self.faults.sort_by_key(|fault| fault.mono_ns);
        let world = self.world.ok_or_else(|| DemoError::NotReady {
            program: "the simulator",
            what: "recorded nothing".into(),
            words: String::new(),
        })?;
        Ok(Report {
            world,
            track: self.track,
            end: self.end,
            faults: self.faults,
            schedule: settings.schedule.clone(),
            ready_ns: self.ready_ns,
            over_ns: self.over_ns,
            complaints,
        })
    }
}
