//! Log records of components: put into a ring by the executor, written by an ordinary thread.
//!
//! An executor never writes to a terminal or pipe itself: a full pipe would stop the robot. A full ring drops the record
//! and counts it.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crossbeam_queue::ArrayQueue;

use crate::model::fault::ShortText;
use crate::model::limits::LOG_RECORDS;

/// One record.
struct Record {
    level: u8,
    slot: ShortText,
    text: ShortText,
}

static RING: OnceLock<ArrayQueue<Record>> = OnceLock::new();
static DROPPED: AtomicU64 = AtomicU64::new(0);

/// How often the writer looks: a person reads no faster.
const PAUSE: Duration = Duration::from_millis(20);

/// Starts the thread that writes records to the daemon's log.
///
/// # Errors
/// When the system has no thread left.
pub fn start() -> std::io::Result<()> {
    if RING.set(ArrayQueue::new(LOG_RECORDS)).is_err() {
        return Ok(());
    }
    std::thread::Builder::new().name("log".into()).spawn(|| {
        loop {
            drain();
            std::thread::sleep(PAUSE);
        }
    })?;
    Ok(())
}

/// Puts a record into the ring: no allocation, no lock, no system call.
pub fn put(level: u8, slot: &str, text: &str) {
    let Some(ring) = RING.get() else { return };
    let record = Record { level, slot: ShortText::new(slot), text: ShortText::new(text) };
    if ring.push(record).is_err() {
        DROPPED.fetch_add(1, Ordering::Relaxed);
    }
}

/// Writes what is in the ring.
pub fn drain() {
    let Some(ring) = RING.get() else { return };
    while let Some(record) = ring.pop() {
        let (slot, text) = (record.slot.as_str(), record.text.as_str());
        match record.level {
            1 => tracing::error!(target: "component", "{slot}: {text}"),
            2 => tracing::warn!(target: "component", "{slot}: {text}"),
            3 => tracing::info!(target: "component", "{slot}: {text}"),
            _ => tracing::debug!(target: "component", "{slot}: {text}"),
        }
    }
    let dropped = DROPPED.swap(0, Ordering::Relaxed);
    if dropped > 0 {
        tracing::warn!("{dropped} log records of components were dropped: they came faster than they could be written");
    }
}
