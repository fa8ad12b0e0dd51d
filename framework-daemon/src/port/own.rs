//! Ends of ports that belong to the daemon itself: it puts events and takes them, with objects of the SDK whose types it knows.
//!
//! For one thread at a time, as the callbacks of a slot are. Only objects of plain data pass here: whatever a plugin
//! left in one, nothing of it is a pointer.
#![allow(unsafe_code, reason = "address of unsafe: objects whose types were compared when the ports were connected")]

use component_sdk::object::CommObject;

use super::input::InPort;
use super::output::{Borrower, OutPort};
use super::pattern::event_server::EventServer;

/// Objects in which no bytes are wrong: those of the fault manager.
pub trait Plain: CommObject + Copy {}

impl EventServer {
    /// Tests every activation: `tells` says what is told to the one with that parameter.
    pub fn put<P: Plain, E: Plain>(&self, tells: impl Fn(&P) -> Option<E>) {
        debug_assert!(
            self.parameter.difference(P::DESCRIPTOR).is_none() && self.event.difference(E::DESCRIPTOR).is_none()
        );
        let mut testing = self.first();
        while testing.status == 0 {
            // SAFETY: a parameter in the server's hands, of the type that was compared when its client was connected.
            let told = tells(unsafe { &*testing.parameter.cast::<P>() });
            let fires = told.is_some();
            // SAFETY: the memory for one event, of that type, which nobody else has; what lay there needs no drop.
            unsafe { testing.event.cast::<E>().write(told.unwrap_or_else(E::empty)) };
            testing = self.next(testing.id, fires);
        }
    }
}

impl OutPort {
    /// Sends an object to every reader.
    pub fn send_own<T: Plain>(&self, object: T) {
        debug_assert!(self.object.difference(T::DESCRIPTOR).is_none());
        let lent = self.loan(Borrower::Callback);
        // SAFETY: a block for one object of the port's type, which nobody else has; what lay there needs no drop.
        unsafe { lent.value.cast::<T>().write(object) };
        let _ = self.publish(lent.value, Borrower::Callback);
    }
}

impl InPort {
    /// Takes the next object, and whether a writer's blocks are where it came from.
    pub fn take_own<T: Plain>(&self, mut is_from: impl FnMut(&dyn Fn(&OutPort) -> bool)) -> Option<T> {
        debug_assert!(self.object.difference(T::DESCRIPTOR).is_none());
        let sample = self.take_next()?;
        is_from(&|port| port.owns(&sample));
        // SAFETY: an object of the port's type, whole until the sample is dropped.
        Some(unsafe { *sample.value().cast::<T>() })
    }
}
