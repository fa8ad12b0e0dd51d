//! Devices that are lost: one fault from the loss until the device is found, whoever tells of it how often.
//!
//! A component tells each time that a device does not work. What lasts is the same fault, until the slot was reset or replaced
//! for whatever reason: then it is one again, because that did not bring the device back.

use crate::model::limits::DEVICES_LOST;
use crate::model::text::Label;

/// A device that is lost.
#[derive(Clone, Copy, Debug)]
pub struct Lost {
    /// Its name.
    pub device: Label,
    /// Since when, in monotonic nanoseconds.
    pub since_ns: u64,
    /// The rules have answered it.
    is_answered: bool,
}

/// The devices of a slot that are lost.
#[derive(Debug)]
pub struct LostDevices(Vec<Lost>);

impl Default for LostDevices {
    fn default() -> Self {
        // Room for all: a recovery may wait for what is noted.
        Self(Vec::with_capacity(DEVICES_LOST))
    }
}

/// What a loss is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum News {
    /// The device worked until now. What was lost longest of too many is forgotten, if so.
    Lost {
        /// Another one was forgotten.
        forgot: bool,
    },
    /// It was lost before; the slot was recovered meanwhile, and that did not help.
    Still,
    /// It was told before.
    Known,
}

impl LostDevices {
    /// That device does not work.
    pub fn lose(&mut self, device: &Label, now_ns: u64) -> News {
        if let Some(known) = self.0.iter_mut().find(|lost| lost.device.as_str() == device.as_str()) {
            let was_answered = std::mem::replace(&mut known.is_answered, true);
            return if was_answered { News::Known } else { News::Still };
        }
        let forgot = self.0.len() == DEVICES_LOST;
        if forgot {
            self.0.remove(0);
        }
        self.0.push(Lost { device: *device, since_ns: now_ns, is_answered: true });
        News::Lost { forgot }
    }

    /// That device works; since when it did not, where it was lost.
    pub fn find(&mut self, device: &Label) -> Option<u64> {
        let place = self.0.iter().position(|lost| lost.device.as_str() == device.as_str())?;
        Some(self.0.remove(place).since_ns)
    }

    /// Whatever is told of them from now on is news: the slot begins anew.
    pub fn begin_anew(&mut self) {
        self.0.iter_mut().for_each(|lost| lost.is_answered = false);
    }

    /// All of them, longest lost first.
    #[must_use]
    pub fn all(&self) -> &[Lost] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    #[derive(Clone, Copy, Debug)]
    enum Step {
        Lose(usize),
        Find(usize),
        Anew,
    }

    fn step() -> impl Strategy<Value = Step> {
        let device = 0..DEVICES_LOST;
        prop_oneof![device.clone().prop_map(Step::Lose), device.prop_map(Step::Find), Just(Step::Anew)]
    }

    proptest! {
        /// A loss is told once, and once more after each new beginning; found is who was lost.
        #[test]
        fn each_loss_is_told_once_until_it_ends(steps in proptest::collection::vec(step(), 0..60)) {
            let (mut devices, mut model) = (LostDevices::default(), BTreeMap::new());
            let name = |device: usize| Label::of(format_args!("device {device}"));
            for (now, step) in (1..).zip(steps) {
                match step {
                    Step::Lose(device) => {
                        let expected = match model.get(&device) {
                            None => News::Lost { forgot: false },
                            Some((_, true)) => News::Known,
                            Some((_, false)) => News::Still,
                        };
                        prop_assert_eq!(devices.lose(&name(device), now), expected);
                        model.entry(device).or_insert((now, true)).1 = true;
                    }
                    Step::Find(device) => {
                        let since = model.remove(&device).map(|(since, _)| since);
                        prop_assert_eq!(devices.find(&name(device)), since);
                    }
                    Step::Anew => {
                        devices.begin_anew();
                        model.values_mut().for_each(|(_, answered)| *answered = false);
                    }
                }
                prop_assert_eq!(devices.all().len(), model.len());
            }
        }
    }

    #[test]
    fn one_too_many_forgets_the_oldest() {
        let mut devices = LostDevices::default();
        for device in 0..=DEVICES_LOST {
            let forgot = device == DEVICES_LOST;
            assert_eq!(devices.lose(&Label::of(format_args!("{device}")), 1), News::Lost { forgot });
        }
        assert_eq!((devices.all().len(), devices.find(&Label::new("0"))), (DEVICES_LOST, None));
    }
}
