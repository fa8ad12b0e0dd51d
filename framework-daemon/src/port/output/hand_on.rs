//! What somebody else has written, handed on as it is: what a voter does with the winner's object.

use std::sync::Arc;

use component_sdk::port::Sent;

use super::super::block::Sample;
use super::super::check::Candidate;
use super::readers::{push, worse};
use super::{Borrower, Link, OutPort, Table, Way};
use crate::model::fault::Fault;

impl OutPort {
    /// Hands an object on to every reader, from any thread. Its block stays its writer's, whom `charge` reaches.
    pub(in crate::port) fn hand_on(&self, sample: &Sample, now_ns: u64, charge: &dyn Fn(&Fault) -> bool) -> Sent {
        let send = |link: &Link| push(&link.target, Arc::clone(sample));
        let all = |table: &Table| table.links.iter().filter_map(|link| link.sent(send)).reduce(worse);
        let plainly = |table: &Table| (table.way != Way::Judged).then(|| all(table).unwrap_or(Sent::Unconnected));
        // Nothing of a plugin is touched while the table is looked at, or a trap would keep it.
        let sent = self.with_table(Borrower::Other, plainly);
        match sent {
            Some(Some(sent)) => sent,
            Some(None) => self.hand_on_judged(sample, now_ns, charge),
            None => Sent::Dropped,
        }
    }

    fn hand_on_judged(&self, sample: &Sample, now_ns: u64, charge: &dyn Fn(&Fault) -> bool) -> Sent {
        let mut links = self.blanks.pop().unwrap_or_default();
        let taps = self.with_table(Borrower::Other, |table| {
            links.extend_from_slice(&table.links);
            table.taps.clone()
        });
        let Some(taps) = taps else { return Sent::Dropped };
        let share = || Some(Arc::clone(sample));
        let table = Table { links, taps, way: Way::Judged };
        // Who hands it on charges whoever wrote it.
        let own = Candidate { value: sample.value(), sample: &share, charge, suspect: &|_, _| {} };
        let sent = self.deliver(&table, &own, now_ns);
        self.keep(table.links);
        sent
    }

    /// Blocks that its readers and those who listen may hold at once.
    pub(in crate::port) fn held(&self) -> usize {
        self.with_table(Borrower::Other, Table::held).unwrap_or_default()
    }
}
