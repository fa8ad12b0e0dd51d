//! The loop: take an event, find its place in the code, write it down, tell it, count it. An ordinary thread: recovery never
//! waits for it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender};
use serde_json::{Map, Value};

use super::feed::Feed;
use super::journal::Journal;
use super::ledger::{Ledger, Verdict};
use crate::exec::recover::lost_events;
use crate::model::fault::{Evidence, Fault, FaultEvent, FaultSender, Memory, Outcome, RestartRequest, Stage};
use crate::model::limits::FAULT_EVENTS;
use crate::model::symptom::Symptom;
use crate::plugin::symbols::{Origin, Symbols};
use crate::sys::{foreign, thread, trap};

/// The journal, shared with those who note starts, reloads and stops.
pub type SharedJournal = Arc<Mutex<Journal>>;

/// The fault manager's thread, and what it shares with the main loop.
#[derive(Debug)]
pub struct Manager {
    thread: JoinHandle<()>,
    restarts: Receiver<RestartRequest>,
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    restart_on_taint: AtomicBool,
    ledger: Mutex<Ledger>,
    feed: Feed,
}

impl Shared {
    fn ledger(&self) -> Ledger {
        *self.ledger.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What the fault manager knows, for whoever looks on.
#[derive(Clone, Debug)]
pub struct Outlook(Arc<Shared>);

impl Outlook {
    /// What faults have cost so far.
    #[must_use]
    pub fn ledger(&self) -> Ledger {
        self.0.ledger()
    }

    /// Its newest lines.
    #[must_use]
    pub fn feed(&self) -> &Feed {
        &self.0.feed
    }
}

/// Starts the fault manager; returns it and where executors put their events.
///
/// # Errors
/// When the system has no thread left.
pub fn start(journal: SharedJournal) -> std::io::Result<(Manager, FaultSender)> {
    let (sender, inbox) = crossbeam_channel::bounded(FAULT_EVENTS);
    // One request is enough: the main loop ends at the first.
    let (asks, restarts) = crossbeam_channel::bounded(1);
    let shared = Arc::new(Shared::default());
    let mut desk = Desk { journal, asks, shared: Arc::clone(&shared), symbols: Symbols::default(), lost: 0 };
    let run = move || inbox.iter().for_each(|event| desk.take(&event));
    let thread = thread::spawn("fault-manager", run)?;
    Ok((Manager { thread, restarts, shared }, sender))
}

impl Manager {
    /// Waits until all events are written: until every executor is gone, but no longer than `limit`, because one that hangs
    /// in a callback never goes. Returns what faults have cost.
    pub fn finish(self, limit: Duration) -> Ledger {
        let began = Instant::now();
        while !self.thread.is_finished() && began.elapsed() < limit {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.ledger()
    }

    /// Where requests for a restart come.
    #[must_use]
    pub const fn restarts(&self) -> &Receiver<RestartRequest> {
        &self.restarts
    }

    /// From now on suspect memory asks for a restart, or no longer.
    pub fn restart_on_taint(&self, wanted: bool) {
        self.shared.restart_on_taint.store(wanted, Ordering::Relaxed);
    }

    /// What faults have cost so far.
    #[must_use]
    pub fn ledger(&self) -> Ledger {
        self.shared.ledger()
    }

    /// What it knows, for whoever looks on.
    #[must_use]
    pub fn outlook(&self) -> Outlook {
        Outlook(Arc::clone(&self.shared))
    }
}

/// The thread's side.
struct Desk {
    journal: SharedJournal,
    asks: Sender<RestartRequest>,
    shared: Arc<Shared>,
    symbols: Symbols,
    lost: u64,
}

impl Desk {
    fn take(&mut self, event: &FaultEvent) {
        self.note_lost();
        // Whoever reads of a fault finds it counted.
        let verdict = self.count(event);
        let origin = match &event.fault.evidence {
            Evidence::Trap(trap) => self.symbols.origin(trap),
            _ => Origin::default(),
        };
        let written = self.journal.lock().unwrap_or_else(PoisonError::into_inner).fault(event, &origin);
        self.publish(written);
        tell(event, &origin);
        verdict.into_iter().for_each(|verdict| self.obey(verdict));
    }

    fn note_lost(&mut self) {
        let (now, before) = (lost_events(), self.lost);
        if now > before {
            tracing::error!("{} faults came faster than they could be written down", now - before);
            let count = Map::from_iter([("count".into(), (now - before).into())]);
            let written = self.journal.lock().unwrap_or_else(PoisonError::into_inner).tell("lost", count);
            self.publish(written);
            self.lost = now;
        }
    }

    /// Whoever follows the faults sees them also where the journal's disk is full.
    fn publish(&self, (line, written): (Map<String, Value>, std::io::Result<()>)) {
        if let Err(error) = written {
            tracing::error!("the journal cannot be written: {error}");
        }
        if !line.is_empty() {
            self.shared.feed.push(line);
        }
    }

    fn count(&self, event: &FaultEvent) -> Option<Verdict> {
        let on_taint = self.shared.restart_on_taint.load(Ordering::Relaxed);
        let threads = trap::threads_lost() + foreign::lost_threads();
        self.shared.ledger.lock().unwrap_or_else(PoisonError::into_inner).note(event, threads, on_taint)
    }

    fn obey(&self, verdict: Verdict) {
        match verdict {
            // A request waits already, or nobody listens any more: either way the daemon ends.
            Verdict::Restart(request) => _ = self.asks.try_send(request),
            Verdict::Warn(text) => tracing::warn!("{text}; beyond it the daemon asks for a restart"),
        }
    }
}

fn tell(event: &FaultEvent, origin: &Origin) {
    let FaultEvent { slot, class, fault, .. } = event;
    let symptom = fault.symptom.name();
    let message = describe(fault, origin);
    if fault.stage != Stage::Confirmed {
        return tracing::info!("slot {slot} ({class}): {symptom} {}: {message}", fault.stage.kind());
    }
    match event.outcome {
        Outcome::Recovered => {
            let took = event.times.first_callback_ns.unwrap_or_default() as f64 / 1e3;
            let successor = event.successor.unwrap_or_default();
            tracing::warn!(
                "slot {slot} ({class}): {symptom}: {message}; {} -> {successor} works again after {took:.1} us",
                action(event)
            );
        }
        Outcome::Stopped => tracing::error!("slot {slot} ({class}): {symptom}: {message}; the slot is stopped"),
        Outcome::Failed => tracing::error!("slot {slot} ({class}): {symptom}: {message}; its {} failed", action(event)),
        Outcome::Ignored => tracing::info!("slot {slot} ({class}): {symptom}: {message}; ignored, as its rules say"),
    }
}

/// What happened, in words: `SIGSEGV at 0x8 in ticker::step+0x12 (libticker.so), memory suspect`.
fn describe(fault: &Fault, origin: &Origin) -> String {
    let mut text = fault.evidence.text().to_owned();
    match &fault.evidence {
        Evidence::Value { port, field, value, limit } if fault.symptom != Symptom::Overload => {
            text = value_in_words(port.as_str(), field.as_str(), *value, *limit);
        }
        Evidence::Silence { silent_ns, max_age_ns, .. } => {
            text.push_str(&format!(" heard nothing for {}, at most {}", time(*silent_ns), time(*max_age_ns)));
        }
        _ => {}
    }
    if let Evidence::Trap(trap) = &fault.evidence
        && matches!(trap.signal, libc::SIGSEGV | libc::SIGBUS)
    {
        text.push_str(&format!(" at {:#x}", trap.address));
    }
    let places = [("in", origin.at.as_ref().map(ToString::to_string)), ("called by", origin.caller.clone())];
    for (word, place) in places {
        text.extend(place.map(|place| format!(" {word} {place}")));
    }
    if fault.memory == Memory::Suspect {
        text.push_str(", memory suspect");
    }
    text
}

fn value_in_words(port: &str, field: &str, value: f64, limit: f64) -> String {
    let place = if field.is_empty() { port.to_owned() } else { format!("{port}, field {field}") };
    if limit.is_nan() { format!("{place}: {value}") } else { format!("{place}: {value}, limit {limit}") }
}

fn time(ns: u64) -> String {
    format!("{:.1} ms", ns as f64 / 1e6)
}

fn action(event: &FaultEvent) -> &'static str {
    match event.answer {
        crate::model::ladder::Answer::Replace => "replacement",
        crate::model::ladder::Answer::Prepare => "spare",
        _ => "reset",
    }
}
