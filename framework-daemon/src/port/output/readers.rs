//! What comes to readers, one after the other: past the checks on the way, into their queues, and what they say to it.

use std::sync::Arc;

use component_sdk::port::Sent;

use super::super::block::Sample;
use super::super::check::{self, Candidate, Verdict};
use super::super::input::{InPort, Pushed};
use super::Link;
use crate::sys::bell::Wakes;

/// Hands a value to every reader.
#[inline]
pub(super) fn send(links: &[Link], sample: &Sample) -> Sent {
    if links.is_empty() {
        return Sent::Unconnected;
    }
    let (mut wakes, mut sent) = (if links.len() > 1 { Wakes::of_many() } else { Wakes::default() }, Sent::Ok);
    for (place, link) in links.iter().enumerate() {
        // Many readers: what the next ones had on another processor is on its way while these are written to.
        if let Some(later) = links.get(place + FETCHED_AHEAD) {
            later.target.bring_near();
        }
        sent = worse(sent, answer(&link.target, link.target.push(Arc::clone(sample), &mut wakes)));
    }
    sent
}

/// Readers whose memory is on its way at a time: as many as it takes to write to while one line comes from another processor.
const FETCHED_AHEAD: usize = 4;

/// Hands a value to one reader, if the checks on the way let it pass.
pub(super) fn deliver_one(link: &Link, candidate: &Candidate<'_>, now_ns: u64) -> Sent {
    match link.checks.judge(&link.target.name, candidate, now_ns) {
        Verdict::Pass => take_in(&link.target, candidate, now_ns),
        Verdict::Instead(held) => {
            let share = || Some(Arc::clone(&held));
            take_in(&link.target, &Candidate { value: held.value(), sample: &share, ..*candidate }, now_ns)
        }
        Verdict::Withhold => Sent::Dropped,
    }
}

/// The reader's own checks, then its queue.
fn take_in(target: &InPort, candidate: &Candidate<'_>, now_ns: u64) -> Sent {
    let passed = match target.checks.judge(&target.name, candidate, now_ns) {
        Verdict::Pass => (candidate.sample)(),
        Verdict::Instead(held) => Some(held),
        Verdict::Withhold => None,
    };
    passed.map_or(Sent::Dropped, |sample| push(target, sample))
}

/// Puts a value that has passed into a reader's queue.
pub(super) fn push(target: &InPort, sample: Sample) -> Sent {
    answer(target, target.take_in(sample, &mut Wakes::default()))
}

#[inline]
fn answer(target: &InPort, pushed: Pushed) -> Sent {
    match pushed {
        Pushed::Kept | Pushed::OldestLost => Sent::Ok,
        Pushed::NewestLost => Sent::Dropped,
        Pushed::Overload => {
            check::report_overload(&target.name);
            Sent::Dropped
        }
    }
}

/// One reader that did not get it is told.
pub(super) fn worse(one: Sent, other: Sent) -> Sent {
    if other == Sent::Ok { one } else { other }
}
