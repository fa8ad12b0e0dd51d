//! The main loop of `run`: boot, then signals until told to stop.

use std::ffi::OsStr;
use std::io::Write;
use std::os::fd::AsFd;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use crossbeam_channel::{Receiver, after, never, select};
use serde_json::{Value, json};

use crate::control::socket::Socket;
use crate::control::{Control, ReloadOrder, Reloaded, views};
use crate::exec::emergency;
use crate::exec::keep::Keep;
use crate::fault::journal::Journal;
use crate::fault::manager::{self, Manager, Outlook, SharedJournal};
use crate::model::fault::RestartRequest;
use crate::model::limits::SHUTDOWN_STEP;
use crate::profile::diagnostic::Diagnostic;
use crate::profile::load;
use crate::profile::plan::OnTaint;
use crate::supervise::boot::{self, BootError};
use crate::supervise::reload::reload;
use crate::supervise::shutdown::shutdown;
use crate::supervise::system::{Placed, System};
use crate::sys::foreign::{self, Report};
use crate::sys::seat::Owner;
use crate::sys::signals::{self, Request};
use crate::sys::thread::SignalStack;
use crate::sys::{fence, last_words, latch, log_ring, mapping, memory, shield, trap};

/// Faults to provoke.
pub mod drill;

/// The boot, which a signal may interrupt.
mod rise;

/// Whom the emergency stop holds that it left latched.
mod held;

/// How the last run ended.
mod last_run;

pub use drill::Injection;
use rise::Risen;

/// What `run` is told.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The profile directory.
    pub directory: PathBuf,
    /// Plugin directories, searched before those that the profiles name.
    pub plugins: Vec<PathBuf>,
    /// Where the journal goes: the one name that it has ([`crate::sys::place::canonical`]).
    pub journal: PathBuf,
    /// What it was called: a link to it, perhaps.
    pub called: PathBuf,
    /// Where the control socket is; `None`: at the usual place, if it can be had.
    pub socket: Option<PathBuf>,
    /// Where checkpoints lie, so that they outlive the daemon.
    pub checkpoints: PathBuf,
    /// What the run before left is forgotten.
    pub fresh: bool,
    /// Faults to provoke.
    pub injections: Vec<Injection>,
}

/// How `run` ended that had begun.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It was told to.
    Stopped,
    /// Its supervisor is to start it anew.
    Restart(RestartRequest),
}

/// Why `run` ended without running.
#[derive(Debug)]
pub enum RunError {
    /// The arguments do not fit the profiles.
    Usage(Vec<String>),
    /// The profiles are invalid.
    Profiles(Vec<Diagnostic>),
    /// Plugins are missing or do not fit.
    Plugins(Vec<String>),
    /// Anything else.
    Failed(Vec<String>),
}

impl RunError {
    fn reasons(&self) -> Vec<String> {
        match self {
            Self::Profiles(diagnostics) => diagnostics.iter().map(ToString::to_string).collect(),
            Self::Usage(reasons) | Self::Plugins(reasons) | Self::Failed(reasons) => reasons.clone(),
        }
    }
}

impl From<std::io::Error> for RunError {
    fn from(error: std::io::Error) -> Self {
        Self::Failed(vec![error.to_string()])
    }
}

impl From<BootError> for RunError {
    fn from(error: BootError) -> Self {
        match error {
            BootError::Plugins(reasons) => Self::Plugins(reasons),
            BootError::Failed(reasons) => Self::Failed(reasons),
        }
    }
}

/// Runs a profile directory until SIGTERM or SIGINT, or until only a restart helps.
///
/// # Errors
/// When it cannot be brought up. Once it runs, it runs.
pub fn run(settings: &Settings, out: &mut impl Write) -> Result<Ending, RunError> {
    let loaded = load::load(&settings.directory).map_err(|diagnostics| {
        let error = RunError::Profiles(diagnostics);
        // A journal that cannot be written either is no news to whoever wrote the profiles.
        let _ = Journal::open_alone(&settings.journal)
            .map(|journal| refuse(&Arc::new(Mutex::new(journal)), settings, &error.reasons()));
        error
    })?;
    loaded.diagnostics.iter().for_each(|diagnostic| tracing::warn!("{diagnostic}"));
    let wrong = drill::check(&settings.injections, &loaded.plan);
    if !wrong.is_empty() {
        return Err(RunError::Usage(wrong));
    }
    let requests = signals::listen()?;
    let cuts = mapping::listen()?;
    log_ring::start()?;
    memory::lock_all().unwrap_or_else(|reason| tracing::warn!("{reason}"));
    let strays = foreign::listen()?;
    trap::install();
    shield::install();
    fence::install();
    // Large enough for the last words of this thread.
    let _signal_stack = SignalStack::new();
    let journal = open_journal(settings)?;
    let (manager, faults) = manager::start(Arc::clone(&journal))?;
    manager.restart_on_taint(loaded.plan.system.on_taint == OnTaint::Restart);
    let mut control = match open_control(settings, &manager) {
        Ok(control) => control,
        Err(reason) => {
            drop(faults);
            give_up(&journal, manager, settings, std::slice::from_ref(&reason));
            return Err(RunError::Failed(vec![reason]));
        }
    };
    let mut plan = loaded.plan;
    last_run::restore_latch(settings, &mut plan, &journal);
    let keep = open_keep(settings);
    let plan = Arc::new(plan);
    let risen = rise::rise(plan, settings.plugins.clone(), faults, keep.clone(), &requests)?;
    let (system, reload) = match risen {
        Risen::Up { system, reload } => (*system, reload),
        Risen::Failed(error) => {
            let error = RunError::from(error);
            give_up(&journal, manager, settings, &error.reasons());
            return Err(error);
        }
        Risen::Interrupted => {
            give_up(&journal, manager, settings, &["it was told to end before it was ready".to_owned()]);
            return Ok(Ending::Stopped);
        }
    };
    let mut fields = json!({"accepted": true, "directory": settings.directory, "slots": system.slots.len()});
    let warm = keep.iter().flat_map(|keep| keep.taken_up());
    let warm: Vec<_> = warm.map(|each| json!({"slot": each.slot, "checkpoint": each.age_ns})).collect();
    if !warm.is_empty() {
        fields["taken_up"] = warm.into();
    }
    note(&journal, "start", &fields);
    manager.adopt(boot::cast(&system.plan, &system.slots, &system.helpers));
    latch::describe(last_run::record(settings, &system.plan));
    control.publish(&system);
    // Nobody may be listening any more; the robot runs all the same.
    let _ = announce(&system, &manager.outlook(), out);
    let pending = drill::sorted(&settings.injections);
    let mut daemon = Daemon { settings, system, journal, manager, control, keep, began: Instant::now(), pending };
    if reload {
        let _ = daemon.reload();
    }
    Ok(daemon.serve(&requests, &strays, &cuts))
}

fn open_journal(settings: &Settings) -> Result<SharedJournal, RunError> {
    let journal = Journal::open_alone(&settings.journal)
        .map_err(|error| RunError::Failed(vec![format!("journal {}: {error}", settings.journal.display())]))?;
    last_words::prepare(journal.as_fd())?;
    if let Some(told) = journal.last().and_then(Value::as_object).and_then(last_run::tell) {
        tracing::warn!("{told}");
    }
    Ok(Arc::new(Mutex::new(journal)))
}

/// The file of checkpoints; where it cannot be had the robot runs all the same.
fn open_keep(settings: &Settings) -> Option<Arc<Keep>> {
    let keep = Keep::open(&settings.checkpoints, &settings.directory, settings.fresh);
    let path = settings.checkpoints.display();
    keep.map_err(|error| tracing::warn!("checkpoints {path}: {error}; they do not outlive the daemon")).ok()
}

/// The control socket: where it was asked for it must be had, at the usual place it may be another daemon's.
fn open_control(settings: &Settings, manager: &Manager) -> Result<Control, String> {
    let taken = settings.socket.as_deref().map_or_else(Socket::take_default, Socket::take);
    let control = taken.and_then(|socket| {
        tracing::info!("control socket: {}", socket.path().display());
        let control = Control::start(socket, settings.directory.clone(), manager.outlook());
        control.map_err(|error| format!("control socket: {error}"))
    });
    match control {
        Err(reason) if settings.socket.is_none() => {
            tracing::warn!("{reason}; it runs without");
            Ok(Control::absent())
        }
        control => control,
    }
}

/// A boot that came to nothing is in the journal, with the faults that it was given up for.
fn give_up(journal: &SharedJournal, manager: Manager, settings: &Settings, reasons: &[String]) {
    manager.finish(SHUTDOWN_STEP);
    refuse(journal, settings, reasons);
}

/// Reasons that are written down of a start that was refused; the others were told.
const REASONS: usize = 20;

fn refuse(journal: &SharedJournal, settings: &Settings, reasons: &[String]) {
    let kept = &reasons[..reasons.len().min(REASONS)];
    note(journal, "start", &json!({"accepted": false, "directory": settings.directory, "reasons": kept}));
}

/// One line for whoever waits for it.
fn announce(system: &System, outlook: &Outlook, out: &mut impl Write) -> std::io::Result<()> {
    let slots = system.slots.iter().map(|placed| placed.slot.name).map(|name| match outlook.reason(name) {
        Some(reason) => format!("{name} (held: {reason})"),
        None => name.to_owned(),
    });
    let slots: Vec<_> = slots.collect();
    writeln!(out, "ready: {} slots on {} executors: {}", slots.len(), system.executors.len(), slots.join(", "))?;
    out.flush()
}

fn note(journal: &SharedJournal, kind: &str, fields: &Value) {
    let fields = fields.as_object().cloned().unwrap_or_default();
    if let Err(error) = journal.lock().unwrap_or_else(PoisonError::into_inner).note(kind, fields) {
        tracing::error!("the journal cannot be written: {error}");
    }
}

struct Daemon<'a> {
    settings: &'a Settings,
    system: System,
    journal: SharedJournal,
    manager: Manager,
    control: Control,
    keep: Option<Arc<Keep>>,
    began: Instant,
    pending: Vec<Injection>,
}

impl Daemon<'_> {
    fn serve(mut self, requests: &Receiver<Request>, strays: &Receiver<Report>, cuts: &Receiver<()>) -> Ending {
        let mut cuts = cuts.clone();
        let restarts = self.manager.restarts().clone();
        let orders = self.control.orders().clone();
        let ending = loop {
            let alarm =
                self.pending.last().map_or_else(never, |next| after(next.after.saturating_sub(self.began.elapsed())));
            select! {
                recv(requests) -> request => match request {
                    // Many reloads at once are one, and a stop among them wins.
                    Ok(Request::Reload) if requests.try_iter().any(|other| other == Request::Stop) => break Ending::Stopped,
                    Ok(Request::Reload) => _ = self.reload(),
                    Ok(Request::Status) => self.tell_status(),
                    Ok(Request::Stop) | Err(_) => break Ending::Stopped,
                },
                recv(restarts) -> request => match request {
                    // A stop always wins over a restart.
                    Ok(_) if requests.try_iter().any(|other| other == Request::Stop) => break Ending::Stopped,
                    Ok(request) => break Ending::Restart(request),
                    // The fault manager ends when the last executor does: not before this loop.
                    Err(_) => break Ending::Stopped,
                },
                recv(orders) -> order => {
                    // Many reloads at once are one, and a stop among them wins.
                    let others: Vec<_> = requests.try_iter().collect();
                    if others.contains(&Request::Stop) {
                        break Ending::Stopped;
                    }
                    self.obey(order.into_iter().chain(orders.try_iter()).collect());
                    if others.contains(&Request::Status) {
                        self.tell_status();
                    }
                }
                recv(strays) -> report => report.iter().for_each(|report| self.blame(report)),
                recv(cuts) -> cut => {
                    if cut.is_ok() {
                        self.tell_cut();
                    }
                    // Told once.
                    cuts = never();
                }
                recv(alarm) -> _ => self.inject(),
            }
        };
        if let Ending::Restart(RestartRequest { reason }) = &ending {
            tracing::error!("{reason}: the daemon ends in order and asks its supervisor for a restart");
            note(&self.journal, "restart", &json!({"reason": reason}));
        }
        self.stop(&ending);
        ending
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

    /// Somebody cut the file of checkpoints short.
    fn tell_cut(&self) {
        let file = self.keep.as_ref().map(|keep| keep.path().display().to_string()).unwrap_or_default();
        tracing::error!(
            "checkpoints {file}: somebody cut the file short: what slots keep there serves this run, and the next one begins anew"
        );
        note(&self.journal, "checkpoints", &json!({"file": file, "event": "cut"}));
    }

    fn inject(&mut self) {
        if let Some(injection) = self.pending.pop() {
            drill::provoke(&injection, &self.system);
        }
    }

    /// One reload for all who wait for one.
    fn obey(&mut self, orders: Vec<ReloadOrder>) {
        if !orders.is_empty() {
            let reloaded = self.reload();
            orders.into_iter().for_each(|order| order.answer(&reloaded));
        }
    }

    fn reload(&mut self) -> Reloaded {
        // A reload would build and start what the emergency stop stopped.
        if emergency::latched() {
            let reason = "not reloaded: the emergency stop is latched".to_owned();
            tracing::error!("{reason}");
            return Err(vec![reason]);
        }
        tracing::info!("reloading {}", self.settings.directory.display());
        self.control.reloading();
        self.manager.withdraw();
        let result = load::load(&self.settings.directory)
            .map_err(|diagnostics| diagnostics.iter().map(ToString::to_string).collect::<Vec<_>>())
            .and_then(|loaded| reload(&mut self.system, &Arc::new(loaded.plan), &self.settings.plugins));
        self.manager.adopt(boot::cast(&self.system.plan, &self.system.slots, &self.system.helpers));
        self.control.publish(&self.system);
        match &result {
            Ok(changes) => {
                self.manager.restart_on_taint(self.system.plan.system.on_taint == OnTaint::Restart);
                latch::describe(last_run::record(self.settings, &self.system.plan));
                tracing::info!("{changes}");
                let mut fields = json!({"accepted": true, "added": changes.added, "changed": changes.changed,
                    "removed": changes.removed, "kept": changes.kept});
                if !changes.taken_up.is_empty() {
                    fields["taken_up"] = changes.taken_up.as_slice().into();
                }
                note(&self.journal, "reload", &fields);
            }
            Err(reasons) => {
                reasons.iter().for_each(|reason| tracing::error!("{reason}"));
                tracing::error!("not reloaded: everything runs on as it was");
                note(&self.journal, "reload", &json!({"accepted": false, "reasons": reasons}));
            }
        }
        result
    }

    fn tell_status(&self) {
        let outlook = self.manager.outlook();
        let slots = self.system.slots.iter().map(|placed| views::of_running(&placed.slot, &placed.shelf, &outlook));
        let (slots, process): (Vec<Value>, _) = (slots.collect(), views::of_process(self.manager.ledger()));
        views::status_table(&slots, &process).iter().for_each(|line| tracing::info!("{line}"));
        note(&self.journal, "status", &json!({"slots": slots, "process": process}));
    }

    fn stop(self, ending: &Ending) {
        // Whoever asks from now on finds nobody, not a system that is half gone.
        drop(self.control);
        self.manager.withdraw();
        let slots = self.system.slots.iter().map(|placed| &placed.slot);
        let slots: Vec<_> = slots.map(|slot| (Arc::clone(slot), slot.status.state())).collect();
        shutdown(self.system);
        let ledger = self.manager.finish(SHUTDOWN_STEP);
        // Counters with what the way out added, states as they were before it.
        let slots: Vec<Value> = slots.iter().map(|(slot, state)| views::of_slot(slot, *state)).collect();
        // Asked for a restart, the next run goes on from what this one leaves.
        if *ending == Ending::Stopped {
            self.keep.iter().for_each(|keep| keep.forget());
        }
        note(&self.journal, "stop", &json!({"slots": slots, "process": views::of_process(ledger)}));
        if ledger.tainted > 0 {
            tracing::warn!("memory was suspect after {} faults of this run", ledger.tainted);
        }
        latch::finish();
        log_ring::flush(SHUTDOWN_STEP);
    }
}
