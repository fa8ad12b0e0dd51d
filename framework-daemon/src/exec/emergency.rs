//! The emergency stop: on the thread that saw the fault, at once. First the safe outputs of all actuators are written from
//! there, then it is latched, then the actuators' executors are told, each of which enters `on_emergency`, stops its slot
//! and writes its outputs once more. The latch outlives the daemon ([`crate::sys::latch`]): one that comes up latched writes the outputs
//! when they are registered, and starts no actuator.
//!
//! One for the process, as the outputs are. The latch and the outputs are atomics, the signals of the actuators are exchanged as
//! a whole: whoever raises it takes no lock, because it may be in the middle of a callback, as a voter is that finds too few
//! of its members agree, and a callback may be ended at any instruction.

use std::sync::{Arc, LazyLock, OnceLock};

use crossbeam_channel::Sender;

use crate::model::lifecycle::State;
use crate::port::exchange::Exchange;
use crate::sys::bell::{Ring, Signal};
use crate::sys::latch::Mark;
use crate::sys::{clock, latch, safe_outputs};

static ACTUATORS: LazyLock<Exchange<Vec<Actuator>>> = LazyLock::new(|| Exchange::new(Vec::new()));
static LISTENER: OnceLock<Sender<Notice>> = OnceLock::new();

/// Who gets the emergency stop.
#[derive(Clone)]
pub struct Actuator {
    /// Its slot.
    pub slot: &'static str,
    /// Rings for it.
    pub signal: Arc<Signal>,
}

/// What happened, for the journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Notice {
    /// It was raised.
    Raised {
        /// Slot whose fault raised it.
        slot: &'static str,
        /// Time of the fault.
        at_ns: u64,
        /// When all outputs were written.
        written_ns: u64,
        /// Outputs that were taken whole.
        outputs: u32,
        /// It was not latched before.
        is_first: bool,
        /// Which raise it was.
        mark: Mark,
    },
    /// An actuator was stopped.
    Stopped {
        /// Its slot.
        slot: &'static str,
        /// The state that it is in.
        state: State,
        /// Its outputs that were taken whole, now that it is stopped.
        outputs: u32,
        /// When.
        at_ns: u64,
    },
}

/// Where notices go; once in the life of a process, later calls change nothing.
pub fn listen(listener: Sender<Notice>) {
    // Before anybody raises it.
    LazyLock::force(&ACTUATORS);
    let _ = LISTENER.set(listener);
}

/// Who gets the emergency stop from now on.
pub fn arm(actuators: Vec<Actuator>) {
    let slots: Vec<&'static str> = actuators.iter().map(|actuator| actuator.slot).collect();
    safe_outputs::arm(&slots);
    latch::guard(slots);
    if ACTUATORS.edit(|_| actuators).is_err() {
        // Only this thread arms it.
        tracing::error!("the emergency stop: its actuators are being changed all the time: those from before get it");
    }
    if latched() {
        // The run before left it so.
        let _ = safe_outputs::write_armed();
    }
}

/// Brings the robot to its safe state, for a fault of that slot, or voter, at that time. Any thread, also within a callback.
pub fn raise(slot: &'static str, at_ns: u64) {
    latch::foretell();
    let outputs = safe_outputs::write_armed();
    let written_ns = clock::now_ns();
    let (mark, is_first) = latch::set();
    // Before those who are told tell what they did.
    tell(Notice::Raised { slot, at_ns, written_ns, outputs, is_first, mark });
    ring();
    if is_first {
        // Not before they were told: a disk may let it wait, and what drives may not.
        latch::store();
    }
}

/// Tells the actuators' executors; who has heard it is not disturbed. The fault manager does so again: the thread that raised it
/// may have been given up in the middle.
pub fn ring() {
    // Where too many do so at the same moment, they are told by those.
    let _ = ACTUATORS.visit(|actuators| actuators.iter().for_each(|actuator| actuator.signal.ring(Ring::Emergency)));
}

/// Tells whoever listens. A full queue loses the line, not the stop.
pub(super) fn tell(notice: Notice) {
    if let Some(listener) = LISTENER.get() {
        let _ = listener.try_send(notice);
    }
}

/// True while it is latched.
#[must_use]
pub fn latched() -> bool {
    latch::is_set()
}

/// Takes it back as it is now; `None`: it was not latched.
#[must_use]
pub fn clear() -> Option<latch::Cleared> {
    latch::mark().and_then(latch::clear)
}
