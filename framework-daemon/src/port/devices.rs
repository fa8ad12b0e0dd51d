//! What components tell of their devices, on its way to the slot: a charge, which its executor takes up between callbacks,
//! from whatever thread it comes. Who tells is found by the seat of the thread, because a component's own threads have no
//! context.
//!
//! A component tells all the time that a device works. As long as none of its slot is lost that ends here, at a look at a
//! counter.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

use abi_stable::std_types::RStr;
use component_sdk::abi::device::DeviceApi;

use super::border::make_sure_of_stack;
use super::charge::{Accused, Charges};
use super::exchange::{Busy, Exchange};
use crate::detect::device::Lost;
use crate::model::fault::{Evidence, Fault, Label, ShortText, Stage};
use crate::model::symptom::Symptom;
use crate::sys::seat::{self, Note, Owner};
use crate::sys::{clock, log_ring};

/// What every plugin is given.
pub(super) const API: DeviceApi = DeviceApi { lost, found };

/// The devices of a slot.
pub struct Devices {
    charges: Arc<Charges>,
    /// Those that are lost, and losses that were told and not taken up: as long as there are any, that one works is news.
    open: AtomicUsize,
    /// Those that are lost, for whoever asks.
    lost: Exchange<Arc<[Lost]>>,
}

impl Devices {
    /// None is lost; what is told of them is charged there.
    #[must_use]
    pub fn new(charges: Arc<Charges>) -> Self {
        Self { charges, open: AtomicUsize::new(0), lost: Exchange::new(Arc::default()) }
    }

    /// Those that are lost, longest first.
    #[must_use]
    pub fn lost(&self) -> Arc<[Lost]> {
        self.lost.visit(Arc::clone).unwrap_or_default()
    }

    /// These are lost from now on. The slot's executor.
    pub fn publish(&self, lost: &[Lost]) {
        // Nobody else edits it.
        let _ = self.lost.edit(|_| lost.into());
    }

    /// One loss less is open: it was told before, or is over. The slot's executor.
    pub fn settle(&self) {
        self.open.fetch_sub(1, Ordering::SeqCst);
    }

    fn lose(&self, fault: &Fault) {
        // Before it is known to the executor, which may be told of its end right after.
        self.open.fetch_add(1, Ordering::SeqCst);
        if !self.charges.charge(fault) {
            self.settle();
        }
    }
}

/// Slots in the order of their names.
type Directory = Arc<Vec<(&'static str, Arc<Devices>)>>;

static DIRECTORY: LazyLock<Exchange<Directory>> = LazyLock::new(|| Exchange::new(Directory::default()));

/// From now on these are the slots whose devices are told of.
///
/// # Errors
/// Somebody else sets them all the time.
pub fn announce(slots: impl Iterator<Item = (&'static str, Arc<Devices>)>) -> Result<(), Busy> {
    let mut slots: Vec<_> = slots.collect();
    slots.sort_by_key(|(slot, _)| *slot);
    let fresh = Arc::new(slots);
    // What is stale is dropped here, outside.
    DIRECTORY.edit(|_| Arc::clone(&fresh)).map(drop)
}

fn of_slot(slot: &str) -> Option<Arc<Devices>> {
    let find = |directory: &Directory| {
        let place = directory.binary_search_by(|(name, _)| (*name).cmp(slot)).ok()?;
        Some(Arc::clone(&directory[place].1))
    };
    DIRECTORY.visit(find).ok().flatten()
}

extern "C" fn lost(device: RStr<'_>, message: RStr<'_>, os_error: i32) {
    make_sure_of_stack();
    // All is read before anything is held.
    let (device, message) = (Label::new(device.as_str()), ShortText::new(message.as_str()));
    let Owner { slot, instance } = seat::owner();
    let evidence =
        Evidence::Device { device, message, os_error: Some(os_error).filter(|code| *code != 0), lost_ns: 0, instance };
    match of_slot(slot) {
        Some(devices) => devices.lose(&Fault {
            injected: seat::is_left(Note::Injected),
            ..Fault::told(Symptom::Device, clock::now_ns(), evidence)
        }),
        None => {
            log_ring::put(2, slot, "a device that is lost before `start` is not told of: nobody answers for it yet");
        }
    }
}

extern "C" fn found(device: RStr<'_>) {
    make_sure_of_stack();
    let device = Label::new(device.as_str());
    let Owner { slot, instance } = seat::owner();
    let Some(devices) = of_slot(slot).filter(|devices| devices.open.load(Ordering::SeqCst) > 0) else { return };
    let evidence = Evidence::Device { device, message: ShortText::EMPTY, os_error: None, lost_ns: 0, instance };
    let fault = Fault { stage: Stage::Healed, ..Fault::told(Symptom::Device, clock::now_ns(), evidence) };
    // Where it is lost, the next one tells the same.
    let _ = devices.charges.charge(&fault);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::symptom::SeverityTable;
    use crate::sys::bell::{Bell, Signal};

    #[test]
    fn found_is_news_only_while_something_is_lost() {
        let charges = Arc::new(Charges::new("", Signal::new(Bell::new()), &SeverityTable::default()));
        let devices = Arc::new(Devices::new(Arc::clone(&charges)));
        assert!(announce([("rover", Arc::clone(&devices))].into_iter()).is_ok());
        seat::adopt(Owner { slot: "rover", instance: 4 });
        found(RStr::from_str("sonar"));
        assert!(charges.next().is_none());
        lost(RStr::from_str("sonar"), RStr::from_str("gone"), 19);
        found(RStr::from_str("sonar"));
        let Evidence::Device { device, message, os_error, instance, .. } = charges.next().unwrap().evidence else {
            panic!("the evidence of a device");
        };
        assert_eq!((device.as_str(), message.as_str(), os_error, instance), ("sonar", "gone", Some(19), 4));
        assert_eq!(charges.next().unwrap().stage, Stage::Healed);
        devices.settle();
        found(RStr::from_str("sonar"));
        assert!(charges.next().is_none());
        seat::adopt(Owner::NONE);
    }
}
