//! The table behind port handles: a handle is a place in it and that place's generation.
//!
//! Places never move and are reused with the next generation, so that a handle that is stale or forged finds nothing,
//! and nothing of the daemon stays behind with an instance that is never dropped. The address of a binding was the
//! handle before: it had to be leaked with each instance that trapped.
//!
//! Who looks a handle up from within its own instance's callback needs no count, because only that thread can end the
//! instance. Any other thread (one that the component started) holds the place by a count while it is inside.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicPtr, AtomicU32, AtomicU64, Ordering};

use component_sdk::abi::payload::PortHandle;
use crossbeam_queue::SegQueue;

use crate::model::limits::{HANDLE_CHUNKS, HANDLES_PER_CHUNK};

/// What a place stands for at the moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Kind {
    /// Nobody's, or of an instance that was replaced.
    Closed,
    /// Input of an instance that stands ready: it reads as empty.
    RestingIn,
    /// Output of one: what it writes goes nowhere.
    RestingOut,
    /// Input of the instance in use.
    In,
    /// Output of the instance in use.
    Out,
    /// Either end of a query or an event, of an instance that stands ready: not connected.
    RestingCalls,
    /// Client of the instance in use.
    Requestor,
    /// Server of the instance in use.
    Provider,
    /// Client of events of the instance in use.
    EventClient,
    /// Server of events of the instance in use.
    EventServer,
}

const KINDS: [Kind; 10] = [
    Kind::Closed,
    Kind::RestingIn,
    Kind::RestingOut,
    Kind::In,
    Kind::Out,
    Kind::RestingCalls,
    Kind::Requestor,
    Kind::Provider,
    Kind::EventClient,
    Kind::EventServer,
];

/// One place. A cache line each: neighbours belong to other executors.
#[derive(Default)]
#[repr(align(64))]
pub(super) struct Place {
    /// Generation in the upper half, kind in the lower.
    state: AtomicU64,
    /// The instance whose handle it is, or its task that the port was moved into.
    pub(super) owner: AtomicU64,
    /// The instance, whichever of its strands has the port.
    pub(super) instance: AtomicU64,
    /// The slot's port.
    pub(super) port: AtomicPtr<()>,
    /// What a resting output lends.
    pub(super) scratch: AtomicPtr<()>,
    /// Threads other than the owner's that are inside.
    visitors: AtomicU32,
}

static CHUNKS: [OnceLock<Box<[Place]>>; HANDLE_CHUNKS] = [const { OnceLock::new() }; HANDLE_CHUNKS];
static FREE: SegQueue<u32> = SegQueue::new();
static USED: AtomicU32 = AtomicU32::new(0);

const _: () = assert!(size_of::<usize>() == 8, "a handle has room for a place and its generation");

/// A place that is held by its binding.
#[derive(Clone, Copy, Debug)]
pub(super) struct Claim {
    index: u32,
    generation: u32,
}

impl Claim {
    /// A free place, still closed; `None`: the table is full.
    pub(super) fn new() -> Option<Self> {
        let index = FREE.pop().or_else(grow)?;
        let generation = (place(index)?.state.load(Ordering::Acquire) >> 32) as u32 + 1;
        let claim = Self { index, generation };
        claim.set(Kind::Closed);
        Some(claim)
    }

    pub(super) fn place(self) -> Option<&'static Place> {
        place(self.index)
    }

    pub(super) fn handle(self) -> PortHandle {
        PortHandle(std::ptr::without_provenance(((self.generation as usize) << 32) | self.index as usize))
    }

    pub(super) fn set(self, kind: Kind) {
        if let Some(place) = self.place() {
            place.state.store((u64::from(self.generation) << 32) | kind as u64, Ordering::SeqCst);
        }
    }

    /// Gives the place back; false: somebody is inside, so that it can be neither reused nor what it leads to be freed.
    pub(super) fn release(self) -> bool {
        self.set(Kind::Closed);
        let is_left = self.place().is_some_and(|place| place.visitors.load(Ordering::SeqCst) == 0);
        // The last generation of a place is never followed by its first.
        if is_left && self.generation < u32::MAX {
            FREE.push(self.index);
        }
        is_left
    }
}

impl Place {
    /// Enters from a thread that is not its owner's; false: it was closed meanwhile.
    pub(super) fn enter(&self, handle: PortHandle) -> bool {
        self.visitors.fetch_add(1, Ordering::SeqCst);
        let is_open = find(handle).is_some_and(|(_, kind)| kind != Kind::Closed);
        if !is_open {
            self.leave();
        }
        is_open
    }

    pub(super) fn leave(&self) {
        self.visitors.fetch_sub(1, Ordering::SeqCst);
    }
}

/// The place of a handle, if it is of the present generation.
#[inline]
pub(super) fn find(handle: PortHandle) -> Option<(&'static Place, Kind)> {
    let bits = handle.0.addr();
    let place = place(bits as u32)?;
    let state = place.state.load(Ordering::SeqCst);
    let kind = KINDS.get(state as u32 as usize)?;
    (state >> 32 == (bits >> 32) as u64).then_some((place, *kind))
}

#[inline]
fn place(index: u32) -> Option<&'static Place> {
    let index = index as usize;
    CHUNKS.get(index / HANDLES_PER_CHUNK)?.get()?.get(index % HANDLES_PER_CHUNK)
}

/// A place that was never used.
fn grow() -> Option<u32> {
    let next = |used: u32| ((used as usize) < HANDLE_CHUNKS * HANDLES_PER_CHUNK).then_some(used + 1);
    let index = USED.fetch_update(Ordering::AcqRel, Ordering::Acquire, next).ok()?;
    let chunk = &CHUNKS[index as usize / HANDLES_PER_CHUNK];
    chunk.get_or_init(|| (0..HANDLES_PER_CHUNK).map(|_| Place::default()).collect());
    Some(index)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    // One test, because the table is one.
    #[test]
    fn a_stale_handle_finds_nothing_and_its_place_is_used_again_when_nobody_is_inside() {
        let first = Claim::new().unwrap();
        first.set(Kind::In);
        assert!(find(first.handle()).is_some_and(|(_, kind)| kind == Kind::In));
        assert!(first.release());
        assert!(find(first.handle()).is_some_and(|(_, kind)| kind == Kind::Closed));
        let again: Vec<_> = (0..1000).map(|_| Claim::new().unwrap()).collect();
        let same = again.iter().find(|claim| claim.index == first.index).unwrap();
        assert!(same.generation > first.generation && find(first.handle()).is_none());
        again.iter().for_each(|claim| assert!(claim.release()));
        let claim = Claim::new().unwrap();
        claim.set(Kind::Out);
        let place = claim.place().unwrap();
        assert!(place.enter(claim.handle()));
        assert!(!claim.release());
        assert!(!place.enter(claim.handle()), "closed for others");
        place.leave();
        assert!(claim.release());
    }

    proptest! {
        #[test]
        fn no_handle_is_too_wild(bits: usize) {
            let found = find(PortHandle(std::ptr::without_provenance(bits)));
            prop_assert!(found.is_none() || bits >> 32 != 0);
        }
    }
}
