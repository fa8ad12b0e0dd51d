//! The main loop of `run`: boot, then signals until told to stop.

use std::ffi::OsStr;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, after, never, select};
use serde_json::{Map, Value, json};

use crate::exec::slot::Slot;
use crate::fault::journal::Journal;
use crate::fault::manager::{self, Manager, SharedJournal};
use crate::model::lifecycle::State;
use crate::model::limits::{BOOT_STEP, SHUTDOWN_STEP};
use crate::profile::diagnostic::Diagnostic;
use crate::profile::load;
use crate::profile::plan::Plan;
use crate::supervise::boot::{self, BootError};
use crate::supervise::reload::reload;
use crate::supervise::shutdown::shutdown;
use crate::supervise::system::{Placed, System};
use crate::sys::foreign::{self, Owner, Report};
use crate::sys::signals::{self, Request};
use crate::sys::{fence, log_ring, memory, shield, trap};

/// What `run` is told.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The profile directory.
    pub directory: PathBuf,
    /// Plugin directories, searched before those that the profiles name.
    pub plugins: Vec<PathBuf>,
    /// Where the journal goes.
    pub journal: PathBuf,
    /// Faults to provoke.
    pub injections: Vec<Injection>,
}

/// A fault to provoke.
#[derive(Clone, Debug, PartialEq)]
pub struct Injection {
    /// In which slot.
    pub slot: String,
    /// Which one; a number of `component_sdk::abi::inject`.
    pub code: u8,
    /// How long after `ready`.
    pub after: Duration,
}

/// Why `run` ended without running.
#[derive(Debug)]
pub enum RunError {
    /// The profiles are invalid.
    Profiles(Vec<Diagnostic>),
    /// Plugins are missing or do not fit.
    Plugins(Vec<String>),
    /// Anything else.
    Failed(Vec<String>),
}

impl From<std::io::Error> for RunError {
    fn from(error: std::io::Error) -> Self {
        Self::Failed(vec![error.to_string()])
    }
}

/// Runs a profile directory until SIGTERM or SIGINT.
///
/// # Errors
/// When it cannot be brought up. Once it runs, it runs.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<(), RunError> {
    let loaded = load::load(&settings.directory).map_err(RunError::Profiles)?;
    loaded.diagnostics.iter().for_each(|diagnostic| tracing::warn!("{diagnostic}"));
    check_injections(&settings.injections, &loaded.plan)?;
    let requests = signals::listen()?;
    log_ring::start()?;
    memory::lock_all().unwrap_or_else(|reason| tracing::warn!("{reason}"));
    let strays = foreign::listen()?;
    trap::install();
    shield::install();
    fence::install();
    let journal = Journal::open(&settings.journal);
    let journal =
        journal.map_err(|error| RunError::Failed(vec![format!("journal {}: {error}", settings.journal.display())]))?;
    let journal: SharedJournal = Arc::new(Mutex::new(journal));
    let (manager, faults) = manager::start(Arc::clone(&journal))?;
    let system = boot::boot(Arc::new(loaded.plan), &settings.plugins, faults).map_err(|error| match error {
        BootError::Plugins(reasons) => RunError::Plugins(reasons),
        BootError::Failed(reasons) => RunError::Failed(reasons),
    })?;
    note(&journal, "start", &json!({"directory": settings.directory, "slots": system.slots.len()}));
    // Nobody may be listening any more; the robot runs all the same.
    let _ = announce(&system, out);
    let pending = sorted(&settings.injections);
    Daemon { settings, system, journal, manager, began: Instant::now(), pending }.serve(&requests, &strays);
    Ok(())
}

/// One line for whoever waits for it.
fn announce(system: &System, out: &mut impl Write) -> std::io::Result<()> {
    let slots: Vec<_> = system.slots.iter().map(|placed| placed.slot.name).collect();
    writeln!(out, "ready: {} slots on {} executors: {}", slots.len(), system.executors.len(), slots.join(", "))?;
    out.flush()
}

fn check_injections(injections: &[Injection], plan: &Plan) -> Result<(), RunError> {
    let unknown = injections.iter().filter(|injection| plan.slots.iter().all(|slot| slot.name != injection.slot));
    let known: Vec<_> = plan.slots.iter().map(|slot| slot.name.as_str()).collect();
    let reasons: Vec<_> = unknown
        .map(|injection| format!("--inject: there is no slot `{}`; there are: {}", injection.slot, known.join(", ")))
        .collect();
    if reasons.is_empty() { Ok(()) } else { Err(RunError::Failed(reasons)) }
}

/// Last first, so that the next is popped.
fn sorted(injections: &[Injection]) -> Vec<Injection> {
    let mut sorted = injections.to_vec();
    sorted.sort_by_key(|injection| std::cmp::Reverse(injection.after));
    sorted
}

fn note(journal: &SharedJournal, kind: &str, fields: &Value) {
    let fields: Map<String, Value> = fields.as_object().cloned().unwrap_or_default();
    if let Err(error) = journal.lock().unwrap_or_else(PoisonError::into_inner).note(kind, fields) {
        tracing::error!("the journal cannot be written: {error}");
    }
}

struct Daemon<'a> {
    settings: &'a Settings,
    system: System,
    journal: SharedJournal,
    manager: Manager,
    began: Instant,
    pending: Vec<Injection>,
}

impl Daemon<'_> {
    fn serve(mut self, requests: &Receiver<Request>, strays: &Receiver<Report>) {
        loop {
            let alarm =
                self.pending.last().map_or_else(never, |next| after(next.after.saturating_sub(self.began.elapsed())));
            select! {
                recv(requests) -> request => match request {
                    // Many reloads at once are one, and a stop among them wins.
                    Ok(Request::Reload) if requests.try_iter().any(|other| other == Request::Stop) => break,
                    Ok(Request::Reload) => self.reload(),
                    Ok(Request::Stop) | Err(_) => break,
                },
                recv(strays) -> report => report.iter().for_each(|report| self.blame(report)),
                recv(alarm) -> _ => self.inject(),
            }
        }
        self.stop();
    }

    /// Hands a fault on a plugin's thread to the slot that started it; one that the plugin started when it was loaded
    /// belongs to all its slots.
    fn blame(&self, report: &Report) {
        let plugin = report.plugin();
        let is_blamed = |placed: &&Placed| match report.owner {
            Owner::NONE => placed.plugins.iter().any(|each| each.file.file_name().and_then(OsStr::to_str) == plugin),
            owner => placed.slot.name == owner.slot,
        };
        let blamed: Vec<_> = self.system.slots.iter().filter(is_blamed).collect();
        blamed.iter().for_each(|placed| placed.executor.blame(placed.member, *report));
        if blamed.is_empty() {
            tracing::error!("a thread of nobody who is still there failed: {report:?}");
        }
    }

    fn inject(&mut self) {
        let Some(Injection { slot, code, .. }) = self.pending.pop() else { return };
        let Some(placed) = self.system.slot(&slot) else {
            tracing::warn!("no fault was provoked in slot {slot}: it is gone");
            return;
        };
        match placed.executor.inject(placed.member, code, BOOT_STEP) {
            Ok(true) => tracing::info!("fault {code} will be provoked in slot {slot}"),
            Ok(false) => tracing::warn!("no fault was provoked in slot {slot}: it is not running"),
            Err(stuck) => tracing::error!("no fault was provoked in slot {slot}: {stuck}"),
        }
    }

    fn reload(&mut self) {
        tracing::info!("reloading {}", self.settings.directory.display());
        let result = load::load(&self.settings.directory)
            .map_err(|diagnostics| diagnostics.iter().map(ToString::to_string).collect::<Vec<_>>())
            .and_then(|loaded| reload(&mut self.system, &Arc::new(loaded.plan), &self.settings.plugins));
        match result {
            Ok(changes) => {
                tracing::info!(
                    "reloaded: added [{}], changed [{}], removed [{}], {} not touched",
                    changes.added.join(", "),
                    changes.changed.join(", "),
                    changes.removed.join(", "),
                    changes.kept
                );
                note(
                    &self.journal,
                    "reload",
                    &json!({"accepted": true, "added": changes.added,
                    "changed": changes.changed, "removed": changes.removed, "kept": changes.kept}),
                );
            }
            Err(reasons) => {
                reasons.iter().for_each(|reason| tracing::error!("{reason}"));
                tracing::error!("not reloaded: everything runs on as it was");
                note(&self.journal, "reload", &json!({"accepted": false, "reasons": reasons}));
            }
        }
    }

    fn stop(self) {
        let ending = self.system.slots.iter().map(|placed| &placed.slot);
        let ending: Vec<_> = ending.map(|slot| (Arc::clone(slot), slot.status.state())).collect();
        shutdown(self.system);
        self.manager.finish(SHUTDOWN_STEP);
        // Counters with what the way out added, states as they were before it.
        let slots: Vec<Value> = ending.iter().map(|(slot, state)| summary(slot, *state)).collect();
        note(&self.journal, "stop", &json!({"slots": slots, "lost_threads": foreign::lost_threads()}));
    }
}

fn summary(slot: &Slot, state: State) -> Value {
    let status = &slot.status;
    let count = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
    json!({"slot": slot.name, "class": status.class(), "state": state, "cycles": count(&status.cycles),
        "missed": count(&status.missed), "faults": count(&status.faults),
        "quarantined": count(&status.quarantined), "longest_ns": count(&status.longest_ns)})
}
