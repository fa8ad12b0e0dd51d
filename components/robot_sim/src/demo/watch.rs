//! Watches a run through the files that it writes, until it is over.

use std::path::Path;
use std::process::ExitStatus;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::DemoError;
use super::follow::Follower;
use super::journal::{Fault, merge};
use super::process::Process;
use super::progress::{Progress, Standing};
use super::report::Report;
use super::schedule::Injection;
use crate::serve::mono_ns;
use crate::serve::record::{End, Moment, Record};
use crate::world::World;

const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// After the arrival, so that the journal can complete its last entry before the daemon is asked to end.
const SETTLE: Duration = Duration::from_millis(300);

/// What has been seen so far.
pub(super) struct Watch {
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
    /// Follows the simulator's `record` and the daemon's `journal`; the daemon was ready at `ready_ns`.
    pub(super) fn new(record: &Path, journal: &Path, ready_ns: u64) -> Self {
        Self {
            records: Follower::new(record),
            journal: Follower::new(journal),
            world: None,
            track: Vec::new(),
            end: None,
            faults: Vec::new(),
            told: 0,
            ready_ns,
            over_ns: ready_ns,
        }
    }

    /// Watches until the robot arrives, `limit` is over or a process ends; returns complaints.
    pub(super) fn until_over(
        &mut self,
        limit: Duration,
        stop: &AtomicBool,
        progress: &mut Progress,
        (simulator, daemon): (&mut Process, &mut Process),
    ) -> Result<Vec<String>, DemoError> {
        let begin = Instant::now();
        while self.end.is_none() {
            std::thread::sleep(LOOK_PERIOD);
            self.look(progress);
            progress.show(self.standing());
            if stop.load(Ordering::Relaxed) {
                return Err(DemoError::Interrupted);
            }
            let over = Some(limit).filter(|limit| begin.elapsed() > *limit);
            let complaint = died("daemon", daemon)
                .or_else(|| died("simulator", simulator))
                .or_else(|| over.map(|limit| format!("not there after {} s", limit.as_secs())));
            if let Some(complaint) = complaint {
                self.over_ns = mono_ns();
                return Ok(vec![complaint]);
            }
        }
        std::thread::sleep(SETTLE);
        self.over_ns = mono_ns();
        Ok(Vec::new())
    }

    /// Reads what has come since the last look.
    pub(super) fn look(&mut self, progress: &mut Progress) {
        for record in self.records.look::<Record>() {
            match record {
                Record::Start { world, .. } => self.world = Some(world),
                Record::Truth(moment) => self.track.push(moment),
                Record::Power { .. } => {}
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

    /// What the run left behind.
    pub(super) fn report(
        mut self,
        schedule: &[Injection],
        steered: Vec<(u64, String)>,
        complaints: Vec<String>,
    ) -> Result<Report, DemoError> {
        // What the daemon reports while it is being ended is about the end, not about the run.
        self.faults.retain(|fault| fault.mono_ns <= self.over_ns);
        // The simulator lingers and records on.
        let arrived = self.end.map_or(u64::MAX, |end| end.mono_ns);
        self.track.retain(|moment| moment.mono_ns <= arrived);
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
            steered,
            schedule: schedule.to_vec(),
            ready_ns: self.ready_ns,
            over_ns: self.over_ns,
            complaints,
        })
    }
}

fn died(name: &str, process: &mut Process) -> Option<String> {
    let how = |status: ExitStatus| format!("the {name} ended on the way ({status})");
    process.ended().map(|status| format!("{}; its last words:\n{}", how(status), process.last_words()))
}
