//! Devices on the bench: told as a slot tells them, each loss once.

use abi_stable::std_types::RStr;

use super::{Bench, RECORD};
use crate::abi::device::DeviceApi;
use crate::component::Callbacks;

/// What was told of devices.
pub(super) struct Told {
    lost: Vec<String>,
    news: Vec<String>,
}

impl Told {
    pub(super) const NONE: Self = Self { lost: Vec::new(), news: Vec::new() };
}

pub(super) const API: DeviceApi = DeviceApi { lost, found };

extern "C" fn lost(device: RStr<'_>, message: RStr<'_>, _: i32) {
    RECORD.with_borrow_mut(|record| {
        let told = &mut record.devices;
        if told.lost.iter().all(|known| known != device.as_str()) {
            told.lost.push(device.to_string());
            told.news.push(format!("{device} lost: {message}"));
        }
    });
}

extern "C" fn found(device: RStr<'_>) {
    RECORD.with_borrow_mut(|record| {
        let told = &mut record.devices;
        if let Some(place) = told.lost.iter().position(|known| known == device.as_str()) {
            told.lost.remove(place);
            told.news.push(format!("{device} found"));
        }
    });
}

impl<C: Callbacks> Bench<C> {
    /// The devices that are lost, as the component tells.
    #[must_use]
    pub fn lost_devices() -> Vec<String> {
        RECORD.with_borrow(|record| record.devices.lost.clone())
    }

    /// What was told of devices since the last call, each loss once: `left sonar lost: No such device`, `left sonar found`.
    #[must_use]
    pub fn device_news() -> Vec<String> {
        RECORD.with_borrow_mut(|record| std::mem::take(&mut record.devices.news))
    }
}
