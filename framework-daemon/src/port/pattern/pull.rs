//! A server without a handler: its component takes the calls itself, from whatever callback may wait. (The originals'
//! active handler is a queue and a thread of its own behind a handler; here the provider's inbox is the queue.)

use component_sdk::abi::calls::{Lent, Wait};
use component_sdk::status::Status;

use super::provider::Provider;
use crate::port::gate::patience_ns;
use crate::port::wait::Place;

impl Provider {
    /// Takes the next call in hand, waits for it if asked to; by default as long as it takes.
    pub fn pull(&self, wait: Wait, place: &impl Place) -> Lent {
        self.pulled(wait, place).unwrap_or_else(Lent::refused)
    }

    fn pulled(&self, wait: Wait, place: &impl Place) -> Result<Lent, Status> {
        if self.has_handler() {
            return Err(Status::NotAllowed);
        }
        let closings = self.gate.closings();
        if let Some(end) = self.taken() {
            return end;
        }
        if wait == Wait::NONE {
            return Err(Status::NoData);
        }
        if !self.gate.lets_wait(closings) {
            return Err(Status::Cancelled);
        }
        loop {
            let until_ns = place.now_ns().saturating_add(patience_ns(wait, u64::MAX));
            match self.gate.wait(closings, until_ns, place, || self.taken()) {
                // For ever is longer than the longest time.
                Err(Status::Timeout) if wait == Wait::DEFAULT => {}
                end => return end,
            }
        }
    }

    /// The next call in hand; `None`: nothing waits.
    fn taken(&self) -> Option<Result<Lent, Status>> {
        if let Some(taken) = self.take() {
            return Some(Ok(Lent { value: taken.value.cast_mut(), id: taken.id, status: 0, initialised: true }));
        }
        // With its hands full it would wait for itself.
        (!self.has_room()).then_some(Err(Status::Overload))
    }

    /// The gate of the slot: closed, waits for calls end and begin no more.
    pub fn set_blocking(&self, on: bool) {
        self.gate.set_slot(on);
        if !self.has_handler() {
            self.ring();
        }
    }
}
