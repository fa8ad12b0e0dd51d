//! What a successor goes on from: the fields and regions that a component calls critical, copied every so often while it
//! works and put back into the instance that succeeds it.
//!
//! Two copies in turn, each with a checksum: a trap in the middle of one (a region that was unmapped) leaves the other, and
//! a wild write is seen. Copies are made on a fiber like a callback, because the addresses are the component's word. They lie
//! in the file that outlives the daemon (`keep`); where there is none, or no room in it, in the heap. Memory for
//! them is found when instances are made and started, not when they are copied; only what a component registers later than
//! that, and what is more than is foreseen, goes into the heap on the spot.
#![allow(unsafe_code, reason = "address of unsafe: copies between the daemon's memory and a component's")]

use std::sync::Arc;
use std::time::Duration;

use super::keep::{Keep, Room, reason_against};
use super::kept::{self, Kept, Whose, room_of, sum_of};
use crate::model::time::nanoseconds;
use crate::sys::clock;
use crate::sys::copy::{STRIPE, Sum};

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

/// Whose regions they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instance {
    /// Its class.
    pub class: &'static str,
    /// Stands for its plugin's file.
    pub build: u64,
}

/// How a copy is known.
#[derive(Clone, Copy, Default)]
struct Backup {
    /// 0: there is none.
    sum: u64,
    at_ns: u64,
}

/// Memory for two copies.
enum Place {
    Heap([Box<[[u8; STRIPE]]>; 2]),
    File(Room),
}

impl Place {
    fn heap(bytes: usize) -> Self {
        Self::Heap([(); 2].map(|()| vec![[0; STRIPE]; bytes.div_ceil(STRIPE)].into()))
    }

    fn capacity(&self) -> usize {
        match self {
            Self::Heap([copy, _]) => copy.len() * STRIPE,
            Self::File(room) => room.capacity(),
        }
    }

    fn copy(&self, index: usize) -> &[u8] {
        match self {
            Self::Heap(copies) => copies[index].as_flattened(),
            Self::File(room) => room.copy(index),
        }
    }

    fn copy_mut(&mut self, index: usize) -> &mut [u8] {
        match self {
            Self::Heap(copies) => copies[index].as_flattened_mut(),
            Self::File(room) => room.copy_mut(index),
        }
    }
}

/// A whole copy.
#[derive(Clone, Copy, Debug)]
pub struct Whole {
    index: usize,
    /// Its age in nanoseconds.
    pub age_ns: u64,
}

/// Who left the checkpoint that a slot's first instance goes on from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Left {
    /// A daemon that is gone.
    ByRun,
    /// The slot as it was before a reload built it anew.
    ByReload,
}

/// The checkpoint of one slot.
pub struct Checkpoint {
    period_ns: u64,
    next_ns: u64,
    slot: &'static str,
    keep: Option<Arc<Keep>>,
    instance: Option<Instance>,
    layout: Vec<(&'static str, usize)>,
    place: Place,
    backups: [Backup; 2],
    latest: usize,
    pending: Sum,
    /// No instance went on from it yet.
    left: Option<Left>,
    /// It was taken up, and no copy was made since.
    was_taken_up: bool,
}

impl Checkpoint {
    /// One that is made every `period`, in the heap.
    #[must_use]
    pub fn every(period: Duration, slot: &'static str) -> Self {
        Self {
            period_ns: nanoseconds(period),
            next_ns: 0,
            slot,
            keep: None,
            instance: None,
            layout: Vec::new(),
            place: Place::heap(0),
            backups: [Backup::default(); 2],
            latest: 0,
            pending: Sum::default(),
            left: None,
            was_taken_up: false,
        }
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

    /// Gives it a file that outlives the daemon.
    pub fn keep_in(&mut self, keep: Option<Arc<Keep>>) {
        self.keep = keep;
    }

    /// Finds memory for the regions of an instance, or those of others that may come in its place, of which `others` are the
    /// sizes; and the first time what the run before left. May take its time.
    pub fn furnish(&mut self, regions: &[Region], others: &[Vec<usize>], instance: Instance) {
        let layout: Vec<_> = regions.iter().map(|region| (region.name, region.len)).collect();
        let bytes = room_of(layout.iter().map(|(_, len)| *len)).filter(|bytes| *bytes > 0);
        let is_first = self.instance.is_none();
        if self.instance == Some(instance) && layout == self.layout {
            return;
        }
        let others = others.iter().filter_map(|lens| room_of(lens.iter().copied()));
        let most = others.chain(bytes).max().unwrap_or_default();
        if self.place.capacity() < most {
            self.place = self.find_place(most, &layout, instance);
        }
        let whose = Whose { slot: self.slot, class: instance.class, build: instance.build };
        let kept =
            self.keep.as_ref().filter(|_| is_first && bytes.is_some()).and_then(|keep| keep.take(whose, &layout));
        self.describe(layout, instance);
        if let Some(kept) = kept {
            self.take_up(&kept, Left::ByRun);
        }
    }

    /// Memory for copies of that many bytes: in the file, where that has room.
    fn find_place(&self, bytes: usize, layout: &[(&'static str, usize)], instance: Instance) -> Place {
        let whose = Whose { slot: self.slot, class: instance.class, build: instance.build };
        let Some(keep) = &self.keep else { return Place::heap(bytes) };
        match keep.room(bytes, kept::table_of(whose, layout)) {
            Ok(room) => Place::File(room),
            Err(error) => {
                tracing::warn!("slot {}: its checkpoint does not outlive the daemon: {error}", self.slot);
                Place::heap(bytes)
            }
        }
    }

    /// Whose regions are copied from now on; what was copied of others is forgotten.
    fn describe(&mut self, layout: Vec<(&'static str, usize)>, instance: Instance) {
        (self.layout, self.instance, self.backups) = (layout, Some(instance), [Backup::default(); 2]);
        let whose = Whose { slot: self.slot, class: instance.class, build: instance.build };
        let bytes = room_of(self.layout.iter().map(|(_, len)| *len)).unwrap_or_default();
        let fits = self.place.capacity() >= bytes;
        let is_described = match &mut self.place {
            Place::File(room) => fits && room.describe(whose, &self.layout),
            Place::Heap(_) => fits,
        };
        if is_described {
            return;
        }
        if let Place::File(_) = &self.place {
            tracing::warn!(
                "slot {}: its critical regions are more than there were when it was started: its checkpoint does not outlive the \
                 daemon; register them in `initialize`",
                self.slot
            );
        }
        self.place = Place::heap(bytes);
    }

    /// The first instance is to go on from that, which somebody else kept.
    ///
    /// # Errors
    /// Why it cannot.
    pub fn inherit(&mut self, kept: &Kept, left: Left) -> Result<(), String> {
        let instance = self.instance.ok_or_else(|| "it has no critical regions any more".to_owned())?;
        let whose = Whose { slot: self.slot, class: instance.class, build: instance.build };
        if let Some(reason) = reason_against(kept, whose, &self.layout) {
            return Err(reason);
        }
        self.take_up(kept, left);
        Ok(())
    }

    /// The last copy that is whole, of an instance with these regions, for somebody else to keep.
    #[must_use]
    pub fn to_keep(&self, regions: &[Region]) -> Option<Kept> {
        let (whole, instance) = (self.whole_for(regions)?, self.instance?);
        let bytes = room_of(self.layout.iter().map(|(_, len)| *len))?;
        Some(Kept {
            slot: self.slot.to_owned(),
            class: instance.class.to_owned(),
            build: instance.build,
            regions: self.layout.iter().map(|(name, len)| ((*name).to_owned(), *len)).collect(),
            tries: 0,
            at_ns: self.backups[whole.index].at_ns,
            data: self.place.copy(whole.index).get(..bytes)?.to_vec(),
        })
    }

    fn take_up(&mut self, kept: &Kept, left: Left) {
        let copy = self.place.copy_mut(0);
        let Some(copy) = copy.get_mut(..kept.data.len()) else { return };
        copy.copy_from_slice(&kept.data);
        let sum = sum_of(self.layout.iter().map(|(_, len)| *len), copy, kept.at_ns);
        if let Place::File(room) = &mut self.place {
            room.count_tries(kept.tries + 1);
        }
        (self.left, self.was_taken_up, self.latest) = (Some(left), true, 0);
        self.set(0, Backup { sum, at_ns: kept.at_ns });
    }

    fn set(&mut self, index: usize, backup: Backup) {
        self.backups[index] = backup;
        if let Place::File(room) = &mut self.place {
            room.stamp(index, backup.sum, backup.at_ns);
        }
    }

    /// Once: who left it, where the first instance is to go on from it.
    pub fn left(&mut self) -> Option<Left> {
        self.left.take()
    }

    /// The slot went on from what was left.
    pub fn tell_taken_up(&self, left: Left, age_ns: u64) {
        let (slot, age_ms) = (self.slot, age_ns as f64 / 1e6);
        match left {
            Left::ByRun => {
                tracing::warn!("slot {slot}: its checkpoint of the run before is taken up, {age_ms:.1} ms old");
                self.keep.iter().for_each(|keep| keep.tell(slot, age_ns));
            }
            Left::ByReload => {
                tracing::info!("slot {slot}: built anew, it goes on from its checkpoint, {age_ms:.1} ms old");
            }
        }
    }

    /// Sees to it that there is room for the regions of an instance; false: there are none, or they are too large. What was
    /// copied of an instance with other regions is forgotten.
    pub fn make_room(&mut self, regions: &[Region], instance: Instance) -> bool {
        let layout = || regions.iter().map(|region| (region.name, region.len));
        let bytes = room_of(layout().map(|(_, len)| len));
        if bytes.is_none_or(|bytes| bytes == 0) {
            return false;
        }
        if self.instance != Some(instance) || !layout().eq(self.layout.iter().copied()) {
            self.describe(layout().collect(), instance);
        }
        true
    }

    /// Copies the regions, for which there is room; on a fiber.
    pub fn copy(&mut self, regions: &[Region]) {
        let index = 1 - self.latest;
        // What is cut short is no copy.
        self.set(index, Backup::default());
        let (mut sum, mut rest) = (Sum::default(), self.place.copy_mut(index));
        for region in regions {
            let Some((part, behind)) = rest.split_at_mut_checked(region.len.next_multiple_of(STRIPE)) else { return };
            let from = std::ptr::with_exposed_provenance::<u8>(region.address);
            // SAFETY: the component says that its region lies there; where it does not, this traps, on a fiber. The part
            // is the daemon's own and as long as stripes are.
            unsafe { sum.copy(from, part.as_mut_ptr(), region.len) };
            rest = behind;
        }
        self.pending = sum;
    }

    /// The copy is whole: from now on it is the one to go on from.
    pub fn seal(&mut self) {
        let at_ns = clock::now_ns();
        let index = 1 - self.latest;
        self.set(index, Backup { sum: self.pending.finish(at_ns), at_ns });
        self.latest = index;
        if std::mem::take(&mut self.was_taken_up)
            && let Place::File(room) = &mut self.place
        {
            room.count_tries(0);
        }
    }

    /// The last copy that is whole, if an instance with these regions can go on from it.
    #[must_use]
    pub fn whole_for(&self, regions: &[Region]) -> Option<Whole> {
        let has = |(name, len): &(&str, usize)| find(regions, name).is_some_and(|region| region.len == *len);
        let index = [self.latest, 1 - self.latest].into_iter().find(|index| self.is_whole(*index))?;
        let age_ns = clock::now_ns().saturating_sub(self.backups[index].at_ns);
        self.layout.iter().all(has).then_some(Whole { index, age_ns })
    }

    fn is_whole(&self, index: usize) -> bool {
        let Backup { sum, at_ns } = self.backups[index];
        sum != 0 && sum_of(self.layout.iter().map(|(_, len)| *len), self.place.copy(index), at_ns) == sum
    }

    /// Puts a copy into the regions of a successor; on a fiber.
    pub fn restore(&self, whole: Whole, regions: &[Region]) {
        let mut rest = self.place.copy(whole.index);
        for (name, len) in &self.layout {
            let padded = len.next_multiple_of(STRIPE);
            let (Some(region), Some((part, behind))) = (find(regions, name), rest.split_at_checked(padded)) else {
                return;
            };
            let to = std::ptr::with_exposed_provenance_mut::<u8>(region.address);
            // SAFETY: as in `copy`; `whole_for` found that the region is as long as the part.
            unsafe { std::ptr::copy_nonoverlapping(part.as_ptr(), to, *len) };
            rest = behind;
        }
    }

    /// Who went on from it failed at once: the next successor begins anew.
    pub fn forget(&mut self) {
        (0..self.backups.len()).for_each(|index| self.set(index, Backup::default()));
    }
}

fn find<'a>(regions: &'a [Region], name: &str) -> Option<&'a Region> {
    regions.iter().find(|region| region.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    const INSTANCE: Instance = Instance { class: "Class", build: 1 };

    fn regions(values: &mut [u64; 2]) -> [Region; 2] {
        let region =
            |name, value: &mut u64| Region { name, address: std::ptr::from_mut(value).expose_provenance(), len: 8 };
        let [first, second] = values;
        [region("first", first), region("second", second)]
    }

    fn checkpoint(values: &mut [u64; 2]) -> Checkpoint {
        let mut checkpoint = Checkpoint::every(Duration::from_millis(1), "slot");
        let regions = regions(values);
        assert!(checkpoint.whole_for(&regions).is_none());
        assert!(checkpoint.make_room(&regions, INSTANCE));
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
        let whole = checkpoint.whole_for(&turned).unwrap();
        checkpoint.restore(whole, &turned);
        assert_eq!(new, [7, 9]);
        assert!(checkpoint.whole_for(&turned[..1]).is_none(), "one region is missing");
        checkpoint.forget();
        assert!(checkpoint.whole_for(&turned).is_none());
    }

    #[test]
    fn a_damaged_copy_is_not_restored() {
        let mut values = [1, 2];
        let mut checkpoint = checkpoint(&mut values);
        let latest = checkpoint.latest;
        checkpoint.place.copy_mut(latest)[3] ^= 1;
        assert!(checkpoint.whole_for(&regions(&mut values)).is_none());
        checkpoint.place.copy_mut(latest)[3] ^= 1;
        values = [3, 4];
        checkpoint.copy(&regions(&mut values));
        checkpoint.seal();
        let latest = checkpoint.latest;
        checkpoint.place.copy_mut(latest)[64] ^= 1;
        let mut restored = [0, 0];
        let regions = regions(&mut restored);
        checkpoint.restore(checkpoint.whole_for(&regions).unwrap(), &regions);
        assert_eq!(restored, [1, 2], "the one before is there");
    }

    #[test]
    fn regions_beyond_the_limit_are_not_copied() {
        let mut checkpoint = Checkpoint::every(Duration::from_millis(1), "slot");
        let huge = Region { name: "huge", address: 0, len: usize::MAX };
        assert!(!checkpoint.make_room(&[huge, huge], INSTANCE));
        assert!(!checkpoint.make_room(&[], INSTANCE));
    }

    #[test]
    fn the_next_run_goes_on_once_from_what_lies_in_the_file() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("keep");
        let open = || Keep::open(&path, directory.path(), false).unwrap();
        let every = |keep| {
            let mut checkpoint = Checkpoint::every(Duration::from_millis(1), "slot");
            checkpoint.keep_in(Some(keep));
            checkpoint
        };
        let (mut values, keep) = ([5, 6], open());
        let mut first = every(Arc::clone(&keep));
        first.furnish(&regions(&mut values), &[], INSTANCE);
        assert_eq!(first.left(), None);
        first.copy(&regions(&mut values));
        first.seal();
        keep.put_in_place();
        drop((first, keep));
        let mut second = every(open());
        let mut restored = [0, 0];
        let regions = regions(&mut restored);
        second.furnish(&regions, &[vec![1000, 8]], INSTANCE);
        assert_eq!((second.left(), second.left()), (Some(Left::ByRun), None));
        second.restore(second.whole_for(&regions).unwrap(), &regions);
        assert_eq!(restored, [5, 6]);
    }

    #[test]
    fn one_that_is_built_anew_inherits_what_fits() {
        let mut values = [5, 6];
        let old = checkpoint(&mut values);
        let mut regions = regions(&mut values);
        let kept = old.to_keep(&regions).unwrap();
        assert!(old.to_keep(&regions[..1]).is_none(), "a region is gone");
        let anew = |instance: Instance, regions: &[Region]| {
            let mut checkpoint = Checkpoint::every(Duration::from_millis(1), "slot");
            checkpoint.furnish(regions, &[], instance);
            let inherited = checkpoint.inherit(&kept, Left::ByReload);
            (checkpoint, inherited)
        };
        assert!(anew(Instance { build: 2, ..INSTANCE }, &regions).1.unwrap_err().contains("another build"));
        assert!(anew(INSTANCE, &regions[..1]).1.unwrap_err().contains("are others"));
        let (mut new, inherited) = anew(INSTANCE, &regions);
        assert_eq!((inherited, new.left()), (Ok(()), Some(Left::ByReload)));
        let mut restored = [0, 0];
        for (region, value) in regions.iter_mut().zip(&mut restored) {
            region.address = std::ptr::from_mut(value).expose_provenance();
        }
        new.restore(new.whole_for(&regions).unwrap(), &regions);
        assert_eq!(restored, [5, 6]);
    }

    #[test]
    fn more_than_was_foreseen_goes_into_the_heap() {
        let directory = tempfile::tempdir().unwrap();
        let keep = Keep::open(&directory.path().join("keep"), directory.path(), false).unwrap();
        let mut checkpoint = Checkpoint::every(Duration::from_millis(1), "slot");
        checkpoint.keep_in(Some(keep));
        let mut values = [5, 6];
        let small = regions(&mut values);
        checkpoint.furnish(&small, &[], INSTANCE);
        assert!(matches!(checkpoint.place, Place::File(_)));
        let large = vec![7_u8; 3000];
        let large = Region { name: "large", address: large.as_ptr().expose_provenance(), len: 3000 };
        assert!(checkpoint.make_room(&[small[0], large], INSTANCE));
        assert!(matches!(checkpoint.place, Place::Heap(_)));
        checkpoint.copy(&[small[0], large]);
        checkpoint.seal();
        assert!(checkpoint.whole_for(&[small[0], large]).is_some());
    }
}
