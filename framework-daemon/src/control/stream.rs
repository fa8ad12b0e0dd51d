//! Answers that come bit by bit: faults as they happen, the rate of a port.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::composites;
use super::directory::{Besides, Directory, End, Entry};
use super::interface::{PortName, Refusal};
use crate::exec::slot::Slot;
use crate::fault::feed::{Cursor, Feed, Line, Next};
use crate::fault::ports;

/// Somebody who follows the faults.
#[derive(Debug)]
pub(super) struct Follow {
    cursor: Cursor,
    slot: Option<String>,
}

/// True for lines that who asks for this slot's wants: its own, and those of the fault manager about all.
fn is_wanted(line: &Line, slot: Option<&str>) -> bool {
    slot.is_none() || line.get("slot").is_none() || line.get("slot").and_then(Value::as_str) == slot
}

impl Follow {
    /// Begins with the newest `last` lines.
    #[must_use]
    pub(super) fn new(feed: &Feed, slot: Option<String>, last: usize) -> Self {
        let cursor = feed.cursor(last, |line| is_wanted(line, slot.as_deref()));
        Self { cursor, slot }
    }

    /// The parameters of the next reply; `None`: nothing yet.
    pub(super) fn next(&mut self, feed: &Feed) -> Option<Value> {
        while let Some(next) = feed.next(&mut self.cursor) {
            match next {
                Next::Missed(count) => return Some(json!({"missed": count})),
                Next::Line(line) if is_wanted(&line, self.slot.as_deref()) => return Some(json!({"fault": *line})),
                Next::Line(_) => {}
            }
        }
        None
    }

    /// Asks to be woken by the next line; true: there is one already.
    #[must_use]
    pub(super) fn await_line(&self, feed: &Feed) -> bool {
        feed.await_line(self.cursor)
    }
}

/// True when a line of that slot is kept.
pub(super) fn knows(feed: &Feed, slot: &str) -> bool {
    feed.any(|line| line.get("slot").and_then(Value::as_str) == Some(slot))
}

/// The newest `last` lines that are kept, oldest first.
#[must_use]
pub(super) fn list(feed: &Feed, slot: Option<&str>, last: usize) -> Vec<Value> {
    let mut cursor = feed.cursor(last, |line| is_wanted(line, slot));
    let lines = std::iter::from_fn(|| feed.next(&mut cursor));
    let lines = lines.filter_map(|next| match next {
        Next::Line(line) => Some(line),
        Next::Missed(_) => None,
    });
    lines.filter(|line| is_wanted(line, slot)).take(last).map(|line| Value::Object((*line).clone())).collect()
}

/// The rate of a port, measured window by window where values are counted: at an input, or at an ear of a voter or model.
#[derive(Debug)]
pub(super) struct Hz {
    name: PortName,
    measured_at: Point,
    window: Duration,
    began: Instant,
    before: u64,
}

/// Where values of a port are counted.
#[derive(Debug)]
enum Point {
    /// At an input.
    Input(End),
    /// At an output, by the voter or model of that name, which hears it.
    Ear(PortName, String),
}

impl std::fmt::Display for Point {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Input(end) => end.fmt(formatter),
            Self::Ear(_, name) => formatter.write_str(name),
        }
    }
}

impl Hz {
    /// Begins to measure.
    ///
    /// # Errors
    /// When there is no such port, or nobody reads it.
    pub(super) fn new(directory: &Directory, name: PortName, window: Duration, now: Instant) -> Result<Self, Refusal> {
        let measured_at = measuring_point(directory, &composites::inner(directory, &name))?;
        let before = received(directory, &name, &measured_at)?;
        Ok(Self { name, measured_at, window, began: now, before })
    }

    /// The slot whose port it is.
    #[must_use]
    pub(super) fn slot(&self) -> &str {
        &self.name.slot
    }

    /// When the window ends.
    #[must_use]
    pub(super) fn due(&self) -> Instant {
        self.began + self.window
    }

    /// The rate of the window that ends now; the next one begins.
    ///
    /// # Errors
    /// When the port is gone meanwhile.
    pub(super) fn measure(&mut self, directory: &Directory, now: Instant) -> Result<Value, Refusal> {
        let count = received(directory, &self.name, &self.measured_at)?;
        // A slot that a reload built anew counts from 0: what it got in this window is told in none.
        let values = count.saturating_sub(self.before);
        let seconds = now.duration_since(self.began).as_secs_f64();
        (self.before, self.began) = (count, now);
        Ok(json!({"rate": {"slot": self.name.slot, "port": self.name.port, "measured_at": self.measured_at.to_string(),
            "values": values, "seconds": seconds, "hz": values as f64 / seconds.max(f64::MIN_POSITIVE)}}))
    }
}

/// The slot of that name; `besides`: what else would be taken.
///
/// # Errors
/// When there is none.
pub(super) fn entry<'a>(directory: &'a Directory, slot: &str, besides: Besides) -> Result<&'a Entry, Refusal> {
    directory.entry(slot).ok_or_else(|| Refusal::NoSuchComponent(slot.to_owned(), directory.missing(slot, besides)))
}

/// The slot that a port belongs to.
///
/// # Errors
/// When there is none, or it is a voter or composite that has no port of that name.
pub(super) fn owner<'a>(directory: &'a Directory, name: &PortName) -> Result<&'a Entry, Refusal> {
    match directory.missing_port(&name.slot, &name.port) {
        Some(reason) if directory.entry(&name.slot).is_none() => Err(Refusal::NoSuchPort(name.clone(), reason)),
        _ => entry(directory, &name.slot, Besides::All),
    }
}

/// The slot of that name, or what the fault manager's ports belong to.
///
/// # Errors
/// When there is none.
pub(super) fn slot<'a>(directory: &'a Directory, name: &str) -> Result<&'a Arc<Slot>, Refusal> {
    let manager = ports::shared().slot();
    if name == manager.name { Ok(manager) } else { entry(directory, name, Besides::All).map(|entry| &entry.slot) }
}

/// An input itself; for an output the reader whose only writer it is, or else the first, or whoever hears it.
fn measuring_point(directory: &Directory, name: &PortName) -> Result<Point, Refusal> {
    let Some(output) = directory.output(&name.slot, &name.port) else {
        let entry = owner(directory, name)?;
        let end = End { slot: entry.slot.name, port: name.port.clone() };
        return entry.slot.reader(&name.port).map(|_| Point::Input(end)).ok_or_else(|| no_rate(entry, name));
    };
    let wires = directory.wires();
    let writers =
        |end: &&End| directory.entry(end.slot).and_then(|reader| Some(wires.of(reader.slot.reader(&end.port)?).len()));
    let best = wires.of(&output).iter().min_by_key(|end| writers(end).unwrap_or(usize::MAX));
    let ear = || Some(Point::Ear(name.clone(), output.taps()?.first()?.name().to_owned()));
    best.cloned().map(Point::Input).or_else(ear).ok_or_else(|| {
        let reason = format!("nobody reads {}.{}: values are counted where they arrive", name.slot, name.port);
        Refusal::NotMeasurable(name.clone(), reason)
    })
}

fn no_rate(entry: &Entry, name: &PortName) -> Refusal {
    let (slot, port) = (&entry.slot, &name.port);
    let is_event = || slot.events.names().any(|name| name == port);
    if slot.requestor(port).is_some() || slot.provider(port).is_some() || is_event() {
        let reason = format!("{}.{port} is no data port: `port info` tells what it counts", name.slot);
        return Refusal::NotMeasurable(name.clone(), reason);
    }
    Refusal::NoSuchPort(name.clone(), entry.missing(port))
}

fn received(directory: &Directory, name: &PortName, point: &Point) -> Result<u64, Refusal> {
    let count = match point {
        Point::Input(end) => {
            directory.entry(end.slot).and_then(|entry| entry.slot.reader(&end.port)).map(|port| port.counts().0)
        }
        Point::Ear(output, ear) => {
            let taps = directory.output(&output.slot, &output.port).and_then(|output| output.taps());
            taps.and_then(|taps| taps.iter().find(|tap| tap.name() == ear).map(|tap| tap.count()))
        }
    };
    count.ok_or_else(|| Refusal::NoSuchPort(name.clone(), format!("{point}, where it was measured, is gone")))
}

#[cfg(test)]
mod tests {
    use serde_json::Map;

    use super::*;

    fn fault(seq: u64, slot: &str) -> Map<String, Value> {
        Map::from_iter([("seq".into(), seq.into()), ("slot".into(), slot.into())])
    }

    #[test]
    fn who_follows_one_slot_sees_its_faults_and_what_concerns_all() {
        let feed = Feed::default();
        feed.push(fault(1, "a"));
        let mut follow = Follow::new(&feed, Some("a".into()), 1);
        let more = [fault(2, "b"), fault(3, "a"), Map::from_iter([("count".into(), 9.into())])];
        more.into_iter().for_each(|line| feed.push(line));
        let seen: Vec<Value> = std::iter::from_fn(|| follow.next(&feed)).collect();
        let faults = seen.iter().map(|reply| &reply["fault"]);
        let faults: Vec<_> = faults.map(|line| (line["seq"].as_u64(), line["count"].as_u64())).collect();
        assert_eq!(faults, [(Some(1), None), (Some(3), None), (None, Some(9))]);
        assert!(!follow.await_line(&feed));
    }

    #[test]
    fn a_list_holds_the_newest_oldest_first() {
        let feed = Feed::default();
        (0..5).for_each(|seq| feed.push(fault(seq, if seq % 2 == 0 { "a" } else { "b" })));
        let seqs =
            |slot, last| list(&feed, slot, last).iter().map(|line| line["seq"].as_u64().unwrap()).collect::<Vec<_>>();
        assert_eq!(seqs(None, 2), [3, 4]);
        assert_eq!(seqs(Some("a"), 2), [2, 4]);
        assert_eq!(seqs(Some("c"), 9), [] as [u64; 0]);
        assert_eq!(seqs(None, 0), [] as [u64; 0]);
    }
}
