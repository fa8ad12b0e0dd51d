//! A server without a handler: its component takes the calls itself, from whatever callback may wait. (The originals'
//! active handler is a queue and a thread of its own behind a handler; here the provider's inbox is the queue.)

use component_sdk::abi::calls::{Lent, Wait};
use component_sdk::status::Status;

use super::provider::Provider;
use crate::model::limits::DURATION_MAX;
use crate::model::time::nanoseconds;
use crate::port::wait::NotHere;
use crate::sys::clock;

impl Provider {
    /// Takes the next call in hand, waits for it if asked to; by default as long as it takes.
    pub fn pull(&self, wait: Wait, park: impl Fn(u64) -> Result<(), NotHere>) -> Lent {
        self.pulled(wait, park).unwrap_or_else(Lent::refused)
    }

    fn pulled(&self, wait: Wait, park: impl Fn(u64) -> Result<(), NotHere>) -> Result<Lent, Status> {
        if self.has_handler() {
            return Err(Status::NotAllowed);
        }
        let closings = self.gate.closings();
        let until_ns = clock::now_ns().saturating_add(wait.0.min(nanoseconds(DURATION_MAX)));
        loop {
            if let Some(taken) = self.take() {
                return Ok(Lent { value: taken.value.cast_mut(), id: taken.id, status: 0, initialised: true });
            }
            if !self.has_room() {
                // It would wait for itself.
                return Err(Status::Overload);
            }
            if wait == Wait::NONE {
                return Err(Status::NoData);
            }
            if !self.gate.lets_wait(closings) {
                return Err(Status::Cancelled);
            }
            if wait != Wait::DEFAULT && clock::now_ns() >= until_ns {
                return Err(Status::Timeout);
            }
            let until_ns = if wait == Wait::DEFAULT {
                clock::now_ns().saturating_add(nanoseconds(DURATION_MAX))
            } else {
                until_ns
            };
            park(until_ns).map_err(|NotHere| Status::Cancelled)?;
        }
    }

    /// The gate of the slot: closed, waits for calls end and begin no more.
    pub fn set_blocking(&self, on: bool) {
        self.gate.set_slot(on);
        if !self.has_handler() {
            self.ring();
        }
    }
}
