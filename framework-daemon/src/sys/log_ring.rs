//! The log: records go into bounded queues, one ordinary thread writes them to stderr.
//!
//! Nobody else ever writes to a terminal or pipe: a pipe that nobody reads would stop the executors, the fault manager and
//! the main loop, one after the other, and a closed one would end the process by a panic. What does not fit is dropped and
//! counted.

use std::io::{self, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crossbeam_queue::ArrayQueue;

use super::thread;
use crate::model::fault::{Label, ShortText};
use crate::model::limits::{LOG_LINES, LOG_RECORDS};

/// A component's record, of fixed size: an executor allocates nothing for it.
struct Record {
    level: u8,
    slot: Label,
    text: ShortText,
}

struct Queues {
    records: ArrayQueue<Record>,
    lines: ArrayQueue<Vec<u8>>,
    dropped: AtomicU64,
    written: AtomicU64,
    pushed: AtomicU64,
}

static QUEUES: OnceLock<Queues> = OnceLock::new();

/// How often the writer looks: a person reads no faster.
const PAUSE: Duration = Duration::from_millis(5);

/// Starts the thread that writes the log.
///
/// # Errors
/// When the system has no thread left.
pub fn start() -> io::Result<()> {
    let queues = Queues {
        records: ArrayQueue::new(LOG_RECORDS),
        lines: ArrayQueue::new(LOG_LINES),
        dropped: AtomicU64::new(0),
        written: AtomicU64::new(0),
        pushed: AtomicU64::new(0),
    };
    if QUEUES.set(queues).is_err() {
        return Ok(());
    }
    thread::spawn("log", || {
        loop {
            drain();
            std::thread::sleep(PAUSE);
        }
    })?;
    Ok(())
}

/// Puts a component's record into its queue: no allocation, no lock, no system call.
pub fn put(level: u8, slot: &str, text: &str) {
    let Some(queues) = QUEUES.get() else { return };
    let record = Record { level, slot: Label::new(slot), text: ShortText::new(text) };
    queues.count(queues.records.push(record).is_ok());
}

impl Queues {
    fn count(&self, kept: bool) {
        let counter = if kept { &self.pushed } else { &self.dropped };
        counter.fetch_add(1, Ordering::Relaxed);
    }
}

/// Where the daemon's own log goes: a line a write, into the queue.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines;

impl Write for Lines {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        match QUEUES.get() {
            Some(queues) => queues.count(queues.lines.push(line.to_vec()).is_ok()),
            // Before the thread is there nothing runs that a pipe could stop.
            None => _ = io::stderr().write_all(line),
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Writes what waits. A component's record becomes a line of the log, which is written in the same round.
fn drain() {
    let Some(queues) = QUEUES.get() else { return };
    while let Some(record) = queues.records.pop() {
        tell(&record);
        queues.written.fetch_add(1, Ordering::Release);
    }
    let dropped = queues.dropped.swap(0, Ordering::Relaxed);
    if dropped > 0 {
        tracing::warn!("{dropped} log records were dropped: they came faster than they could be written");
    }
    while let Some(line) = queues.lines.pop() {
        // Whoever does not read it any more does not need it.
        let _ = io::stderr().write_all(&line);
        queues.written.fetch_add(1, Ordering::Release);
    }
}

fn tell(record: &Record) {
    let (slot, text) = (record.slot.as_str(), record.text.as_str());
    match record.level {
        1 => tracing::error!(target: "component", "{slot}: {text}"),
        2 => tracing::warn!(target: "component", "{slot}: {text}"),
        3 => tracing::info!(target: "component", "{slot}: {text}"),
        _ => tracing::debug!(target: "component", "{slot}: {text}"),
    }
}

/// Waits until all that was put so far is written, but no longer than `limit`.
pub fn flush(limit: Duration) {
    let Some(queues) = QUEUES.get() else { return };
    let began = Instant::now();
    let is_written = || queues.written.load(Ordering::Acquire) >= queues.pushed.load(Ordering::Acquire);
    while !is_written() && began.elapsed() < limit {
        std::thread::sleep(Duration::from_millis(1));
    }
}
