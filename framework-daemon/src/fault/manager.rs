//! The loop: take an event, write it down, tell it. An ordinary thread: recovery never waits for it.

use std::sync::{Arc, Mutex, PoisonError};

use crossbeam_channel::Receiver;

use super::journal::Journal;
use crate::model::fault::{FaultEvent, FaultSender, Outcome};
use crate::model::limits::FAULT_EVENTS;

/// The journal, shared with those who note starts, reloads and stops.
pub type SharedJournal = Arc<Mutex<Journal>>;

/// Starts the fault manager; returns where executors put their events.
///
/// # Errors
/// When the system has no thread left.
pub fn start(journal: SharedJournal) -> std::io::Result<FaultSender> {
    let (sender, inbox) = crossbeam_channel::bounded(FAULT_EVENTS);
    std::thread::Builder::new().name("fault-manager".into()).spawn(move || run(&inbox, &journal))?;
    Ok(sender)
}

fn run(inbox: &Receiver<FaultEvent>, journal: &SharedJournal) {
    for event in inbox {
        if let Err(error) = journal.lock().unwrap_or_else(PoisonError::into_inner).fault(&event) {
            tracing::error!("the journal cannot be written: {error}");
        }
        tell(&event);
    }
}

fn tell(event: &FaultEvent) {
    let FaultEvent { slot, class, fault, .. } = event;
    let symptom = fault.symptom.name();
    let message = fault.evidence.message();
    let message = message.as_str();
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
        Outcome::Ignored => tracing::info!("slot {slot} ({class}): {symptom}: {message}; ignored, as its rules say"),
    }
}

fn action(event: &FaultEvent) -> &'static str {
    match event.answer {
        crate::model::ladder::Answer::Replace => "replaced",
        _ => "reset",
    }
}
