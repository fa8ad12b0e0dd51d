//! Data wakes a nonperiodic slot.

use std::sync::Arc;

use crate::port::input::Listener;
use crate::sys::arch;
use crate::sys::bell::{Ring, Signal, Wakes};

/// A port's listener that rings for its member.
pub struct Doorbell(pub Arc<Signal>);

impl Listener for Doorbell {
    fn data_arrived<'a>(&'a self, wakes: &mut Wakes<'a>) {
        self.0.ring_among(Ring::Data.into(), wakes);
    }

    fn bring_near(&self) {
        arch::bring_near(Arc::as_ptr(&self.0).addr(), size_of::<Signal>());
    }
}
