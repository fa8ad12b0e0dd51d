//! The loop: take an event, write it down, tell it. An ordinary thread: recovery never waits for it.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use serde_json::Map;

use super::journal::Journal;
use crate::exec::recover::lost_events;
use crate::model::fault::{FaultEvent, FaultSender, Outcome};
use crate::model::limits::FAULT_EVENTS;

/// The journal, shared with those who note starts, reloads and stops.
pub type SharedJournal = Arc<Mutex<Journal>>;

/// The fault manager's thread.
#[derive(Debug)]
pub struct Manager(JoinHandle<()>);

/// Starts the fault manager; returns it and where executors put their events.
///
/// # Errors
/// When the system has no thread left.
pub fn start(journal: SharedJournal) -> std::io::Result<(Manager, FaultSender)> {
    let (sender, inbox) = crossbeam_channel::bounded(FAULT_EVENTS);
    let thread = std::thread::Builder::new().name("fault-manager".into()).spawn(move || run(&inbox, &journal))?;
    Ok((Manager(thread), sender))
}

impl Manager {
    /// Waits until all events are written: until every executor is gone, but no longer than `limit`, because one that hangs
    /// in a callback never goes.
    pub fn finish(self, limit: Duration) {
        let began = Instant::now();
        while !self.0.is_finished() && began.elapsed() < limit {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn run(inbox: &Receiver<FaultEvent>, journal: &SharedJournal) {
    let mut lost = 0;
    for event in inbox {
        let now_lost = lost_events();
        if now_lost > lost {
            tracing::error!("{} faults came faster than they could be written down", now_lost - lost);
            let count = Map::from_iter([("count".into(), (now_lost - lost).into())]);
            let _ = journal.lock().unwrap_or_else(PoisonError::into_inner).note("lost", count);
            lost = now_lost;
        }
        if let Err(error) = journal.lock().unwrap_or_else(PoisonError::into_inner).fault(&event) {
            tracing::error!("the journal cannot be written: {error}");
        }
        tell(&event);
    }
}

fn tell(event: &FaultEvent) {
    let FaultEvent { slot, class, fault, .. } = event;
    let symptom = fault.symptom.name();
    let message = fault.evidence.text();
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

fn action(event: &FaultEvent) -> &'static str {
    match event.answer {
        crate::model::ladder::Answer::Replace => "replacement",
        crate::model::ladder::Answer::Prepare => "spare",
        _ => "reset",
    }
}
