//! Data wakes a nonperiodic slot.

use std::sync::Arc;

use crate::port::input::Listener;
use crate::sys::bell::{Ring, Signal};

/// A port's listener that rings for its member.
pub struct Doorbell(pub Arc<Signal>);

impl Listener for Doorbell {
    fn data_arrived(&self) {
        self.0.ring(Ring::Data);
    }
}
