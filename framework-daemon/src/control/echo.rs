//! The values that pass a port, as they pass it: a tap, which is one more reader with a short queue, is connected beside the
//! others. The writer serves it as any reader; what comes faster than it is looked at is passed over and counted.
//!
//! What the tap holds is given back while its writer is certainly there, because the last holder of a value frees memory that
//! a plugin made: so the directory is held, and changed for the newest as soon as there is a newer one.

use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};

use super::composites;
use super::decode::{Unreadable, decode};
use super::directory::{Directory, Entry};
use super::interface::{PortName, Refusal};
use super::stream::owner;
use crate::model::limits::{ECHO_PAUSE, ECHO_QUEUE};
use crate::port::check::Checks;
use crate::port::input::{InPort, Shown};
use crate::port::output::{Link, OutPort};
use crate::profile::plan::{Overflow, Queue};

/// Somebody who looks at what passes a port.
pub(super) struct Echo {
    name: PortName,
    taps: Vec<Tap>,
    /// Dropped last: it holds the writers.
    directory: Arc<Directory>,
    looked: Instant,
}

/// A reader beside the others.
struct Tap {
    writer: Arc<OutPort>,
    /// The writer as it is named.
    from: String,
    input: Arc<InPort>,
    /// Values that were passed over and told of.
    lost: u64,
}

impl Echo {
    /// Begins to look.
    ///
    /// # Errors
    /// When there is no such port, or it carries no values.
    pub(super) fn new(directory: Arc<Directory>, name: PortName, now: Instant) -> Result<Self, Refusal> {
        let taps = taps(&directory, &name)?;
        Ok(Self { name, taps, directory, looked: now })
    }

    /// The slot whose port it is.
    pub(super) fn slot(&self) -> &str {
        &self.name.slot
    }

    /// When it looks next.
    pub(super) fn due(&self) -> Instant {
        self.looked + ECHO_PAUSE
    }

    /// What came since the last look, as replies.
    ///
    /// # Errors
    /// When the port is gone.
    pub(super) fn look(&mut self, directory: &Arc<Directory>, now: Instant) -> Result<Vec<Value>, Refusal> {
        self.follow(directory, now)?;
        let slot = &self.name.slot;
        Ok(self.taps.iter_mut().flat_map(|tap| tap.values(slot, &self.name.port)).collect())
    }

    /// Goes with its port, whatever becomes of that.
    ///
    /// # Errors
    /// When the port is gone.
    pub(super) fn follow(&mut self, directory: &Arc<Directory>, now: Instant) -> Result<(), Refusal> {
        self.looked = now;
        if !Arc::ptr_eq(&self.directory, directory) || !self.is_whole() {
            let taps = taps(directory, &self.name)?;
            // In this order: what the old ones hold is given back while their writers are there.
            self.taps = taps;
            self.directory = Arc::clone(directory);
        }
        Ok(())
    }

    /// Every writer of the port is tapped: connections change at run time.
    fn is_whole(&self) -> bool {
        writers(&self.directory, &self.name).is_ok_and(|writers| {
            writers.len() == self.taps.len()
                && writers.iter().zip(&self.taps).all(|((writer, _), tap)| tap.is_at(writer))
        })
    }
}

fn taps(directory: &Directory, name: &PortName) -> Result<Vec<Tap>, Refusal> {
    let name = &*composites::inner(directory, name);
    let tap = |(writer, from)| {
        Tap::new(writer, from).ok_or_else(|| {
            let reason =
                format!("{}.{}: its connections are being changed all the time: try again", name.slot, name.port);
            Refusal::NotMeasurable(name.clone(), reason)
        })
    };
    writers(directory, name)?.into_iter().map(tap).collect()
}

/// An output itself; for an input those who write to it.
fn writers(directory: &Directory, name: &PortName) -> Result<Vec<(Arc<OutPort>, String)>, Refusal> {
    if let Some(output) = directory.output(&name.slot, &name.port) {
        return Ok(vec![(output, format!("{}.{}", name.slot, name.port))]);
    }
    let entry = owner(directory, name)?;
    let Some(input) = entry.slot.reader(&name.port) else { return Err(carries_none(entry, name)) };
    let wires = directory.wires();
    let writer = |end: &super::directory::End| Some((directory.output(end.slot, &end.port)?, end.to_string()));
    Ok(wires.of(input).iter().filter_map(writer).collect())
}

fn carries_none(entry: &Entry, name: &PortName) -> Refusal {
    let (slot, port) = (&entry.slot, &name.port);
    let is_event = || slot.events.names().any(|name| name == port);
    if slot.requestor(port).is_some() || slot.provider(port).is_some() || is_event() {
        let reason = format!("{}.{port} is no data port: it carries no values that could be shown", name.slot);
        return Refusal::NotMeasurable(name.clone(), reason);
    }
    Refusal::NoSuchPort(name.clone(), entry.missing(port))
}

impl Tap {
    /// `None`: others change the writer's connections all the time.
    fn new(writer: Arc<OutPort>, from: String) -> Option<Self> {
        let queue = Queue::Fifo { size: ECHO_QUEUE, overflow: Overflow::DropOldest };
        let input = Arc::new(InPort::new("echo", writer.object, queue, Checks::default()).tapping());
        let link = Link { target: Arc::clone(&input), checks: Checks::none() };
        writer.change(|links| links.push(link)).ok()?;
        Some(Self { writer, from, input, lost: 0 })
    }

    /// It is connected to that writer still.
    fn is_at(&self, writer: &Arc<OutPort>) -> bool {
        Arc::ptr_eq(writer, &self.writer) && writer.links().iter().any(|link| Arc::ptr_eq(&link.target, &self.input))
    }

    fn values(&mut self, slot: &str, port: &str) -> Vec<Value> {
        let mut replies = Vec::new();
        // No more than it can hold: a writer must not keep this thread.
        for _ in 0..ECHO_QUEUE {
            let decoded =
                self.input.show_next(|Shown { address, stamp_ns }| (decode(self.writer.object, address), stamp_ns));
            let Some((decoded, stamp_ns)) = decoded else { break };
            let lost = self.input.counts().1;
            let missed = lost.saturating_sub(std::mem::replace(&mut self.lost, lost));
            let (value, unreadable) = match decoded {
                Ok(value) => (value, Value::Null),
                Err(Unreadable { address }) => {
                    (Value::Null, format!("it leads to {address:#x}, where nothing is").into())
                }
            };
            replies.push(json!({"echo": {"slot": slot, "port": port, "from": self.from, "stamp_ns": stamp_ns,
                "missed": missed, "value": value, "unreadable": unreadable}}));
        }
        replies
    }
}

impl Drop for Tap {
    fn drop(&mut self) {
        // Where others change the connections all the time it stays, and costs its writer what any reader does.
        let _ = self.writer.change(|links| links.retain(|link| !Arc::ptr_eq(&link.target, &self.input)));
        while self.input.show_next(|_| ()).is_some() {}
    }
}
