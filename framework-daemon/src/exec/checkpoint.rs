//! What a successor goes on from: the fields and regions that a component calls critical, copied every so often while it
//! works and put back into the instance that succeeds it.
//!
//! Two copies in turn, each with a checksum: a trap in the middle of one (a region that was unmapped) leaves the other, and
//! a wild write is seen. Copies are made on a fiber like a callback, because the addresses are the component's word.
#![allow(unsafe_code, reason = "address of unsafe: copies between the daemon's memory and a component's")]

use std::time::Duration;

use crate::model::limits::CHECKPOINT_BYTES;
use crate::model::time::nanoseconds;
use crate::sys::clock;

/// A part of an instance's checkpoint.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// What it is called.
    pub name: &'static str,
    /// Where it lies.
    pub address: usize,
    /// Its size in bytes.
    pub len: usize,
}

#[derive(Default)]
struct Backup {
    bytes: Vec<u8>,
    sum: u32,
    /// When it was made; 0: there is none.
    at_ns: u64,
}

/// The checkpoint of one slot.
pub struct Checkpoint {
    period_ns: u64,
    next_ns: u64,
    layout: Vec<(&'static str, usize)>,
    backups: [Backup; 2],
    latest: usize,
}

impl Checkpoint {
    /// One that is made every `period`.
    #[must_use]
    pub fn every(period: Duration) -> Self {
        let backups = [Backup::default(), Backup::default()];
        Self { period_ns: nanoseconds(period), next_ns: 0, layout: Vec::new(), backups, latest: 0 }
    }

    /// True when a new copy is due; the next one is due a period later.
    pub fn is_due(&mut self) -> bool {
        let now = clock::now_ns();
        let is_due = now >= self.next_ns;
        if is_due {
            self.next_ns = now + self.period_ns;
        }
        is_due
    }

    /// Makes room for the regions of an instance; false: there are none, or they are too large. What was copied of an
    /// instance with other regions is forgotten.
    pub fn make_room(&mut self, regions: &[Region]) -> bool {
        let layout = || regions.iter().map(|region| (region.name, region.len));
        let bytes: usize = regions.iter().fold(0, |sum, region| sum.saturating_add(region.len));
        if !layout().eq(self.layout.iter().copied()) {
            self.layout = layout().collect();
            self.backups =
                [(); 2].map(|()| Backup { bytes: vec![0; bytes.min(CHECKPOINT_BYTES)], ..Backup::default() });
        }
        (1..=CHECKPOINT_BYTES).contains(&bytes)
    }

    /// Copies the regions, for which there is room; on a fiber.
    pub fn copy(&mut self, regions: &[Region]) {
        let mut rest = self.backups[1 - self.latest].bytes.as_mut_slice();
        for region in regions {
            let Some((part, behind)) = rest.split_at_mut_checked(region.len) else { return };
            let from = std::ptr::with_exposed_provenance::<u8>(region.address);
            // SAFETY: the component says that its region lies there; where it does not, this traps, on a fiber. The part
            // is the daemon's own and as long.
            unsafe { std::ptr::copy_nonoverlapping(from, part.as_mut_ptr(), region.len) };
            rest = behind;
        }
    }

    /// The copy is whole: from now on it is the one to go on from.
    pub fn seal(&mut self) {
        self.latest = 1 - self.latest;
        let backup = &mut self.backups[self.latest];
        backup.sum = crc32fast::hash(&backup.bytes);
        backup.at_ns = clock::now_ns();
    }

    /// Age of the last copy in nanoseconds, if it is whole and an instance with these regions can go on from it.
    #[must_use]
    pub fn age_for(&self, regions: &[Region]) -> Option<u64> {
        let backup = &self.backups[self.latest];
        let has = |(name, len): &(&str, usize)| find(regions, name).is_some_and(|region| region.len == *len);
        let is_whole = backup.at_ns != 0 && crc32fast::hash(&backup.bytes) == backup.sum;
        (is_whole && self.layout.iter().all(has)).then(|| clock::now_ns().saturating_sub(backup.at_ns))
    }

    /// Puts the last copy into the regions of a successor; on a fiber.
    pub fn restore(&self, regions: &[Region]) {
        let mut rest = self.backups[self.latest].bytes.as_slice();
        for (name, len) in &self.layout {
            let (Some(region), Some((part, behind))) = (find(regions, name), rest.split_at_checked(*len)) else {
                return;
            };
            let to = std::ptr::with_exposed_provenance_mut::<u8>(region.address);
            // SAFETY: as in `copy`; `age_for` found that the region is as long as the part.
            unsafe { std::ptr::copy_nonoverlapping(part.as_ptr(), to, *len) };
            rest = behind;
        }
    }

    /// Who went on from it failed at once: the next successor begins anew.
    pub fn forget(&mut self) {
        self.backups.iter_mut().for_each(|backup| backup.at_ns = 0);
    }
}

fn find<'a>(regions: &'a [Region], name: &str) -> Option<&'a Region> {
    regions.iter().find(|region| region.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn regions(values: &mut [u64; 2]) -> [Region; 2] {
        let region =
            |name, value: &mut u64| Region { name, address: std::ptr::from_mut(value).expose_provenance(), len: 8 };
        let [first, second] = values;
        [region("first", first), region("second", second)]
    }

    fn checkpoint(values: &mut [u64; 2]) -> Checkpoint {
        let mut checkpoint = Checkpoint::every(Duration::from_millis(1));
        let regions = regions(values);
        assert!(checkpoint.age_for(&regions).is_none());
        assert!(checkpoint.make_room(&regions));
        checkpoint.copy(&regions);
        checkpoint.seal();
        checkpoint
    }

    #[test]
    fn a_successor_gets_the_last_whole_copy_by_name() {
        let (mut old, mut new) = ([7, 9], [0, 0]);
        let mut checkpoint = checkpoint(&mut old);
        // A copy that was cut short.
        old = [100, 100];
        checkpoint.copy(&regions(&mut old));
        let mut turned = regions(&mut new);
        turned.reverse();
        assert!(checkpoint.age_for(&turned).is_some());
        checkpoint.restore(&turned);
        assert_eq!(new, [7, 9]);
        assert!(checkpoint.age_for(&turned[..1]).is_none(), "one region is missing");
        checkpoint.forget();
        assert!(checkpoint.age_for(&turned).is_none());
    }

    #[test]
    fn a_damaged_copy_is_not_restored() {
        let mut values = [1, 2];
        let mut checkpoint = checkpoint(&mut values);
        let latest = checkpoint.latest;
        checkpoint.backups[latest].bytes[3] ^= 1;
        assert!(checkpoint.age_for(&regions(&mut values)).is_none());
    }

    #[test]
    fn regions_beyond_the_limit_are_not_copied() {
        let mut checkpoint = Checkpoint::every(Duration::from_millis(1));
        let huge = Region { name: "huge", address: 0, len: usize::MAX };
        assert!(!checkpoint.make_room(&[huge, huge]));
        assert!(!checkpoint.make_room(&[]));
    }
}
