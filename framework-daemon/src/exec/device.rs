//! Devices that a slot's component tells of, taken up by its executor as any charge: answered by the slot's rules when they
//! are lost, written down when they are found.

use super::member::{Crew, Member};
use crate::detect::device::News;
use crate::model::fault::{Evidence, Fault, Label, Stage};
use crate::model::lifecycle::State;
use crate::model::symptom::Symptom;

impl Member {
    /// Takes up what was told of a device. Only the instance in use has any.
    pub(super) fn hear_of_device(&mut self, fault: &Fault, crew: &mut Crew) {
        let Evidence::Device { device, instance, .. } = &fault.evidence else { return };
        let is_present = self.unit.as_ref().is_some_and(|unit| unit.owner.instance == *instance);
        match fault.stage {
            Stage::Confirmed if is_present => self.lose_device(device, fault, crew),
            Stage::Confirmed => self.slot.devices.settle(),
            _ if is_present => self.find_device(device, fault, crew),
            _ => {}
        }
    }

    fn lose_device(&mut self, device: &Label, fault: &Fault, crew: &mut Crew) {
        let news = self.lost_devices.lose(device, fault.at_ns);
        if news != (News::Lost { forgot: false }) {
            self.slot.devices.settle();
        }
        if news == News::Known {
            self.slot.charges.leave();
            return;
        }
        if self.state() == State::Active {
            self.handle(fault, crew);
        } else {
            self.note(fault, crew);
            // Where it works again, this waits for an answer.
            self.lost_devices.begin_anew();
        }
        self.slot.devices.publish(self.lost_devices.all());
    }

    fn find_device(&mut self, device: &Label, fault: &Fault, crew: &mut Crew) {
        let Some(since_ns) = self.lost_devices.find(device) else { return };
        self.slot.devices.settle();
        self.slot.devices.publish(self.lost_devices.all());
        let mut healed = *fault;
        if let Evidence::Device { lost_ns, .. } = &mut healed.evidence {
            *lost_ns = fault.at_ns.saturating_sub(since_ns);
        }
        self.note(&healed, crew);
    }

    /// True for what a component told of a device.
    pub(super) const fn is_of_device(fault: &Fault) -> bool {
        matches!(fault.symptom, Symptom::Device) && matches!(fault.evidence, Evidence::Device { .. })
    }
}
