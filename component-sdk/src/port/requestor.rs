//! What every end has in common that asks or listens: it connects itself, and says by which name others may wire it.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Asks whoever it was told to ask; nobody else wires its port.
//! #[derive(Component)]
//! #[component(name = "Chooser", periodic = "1s")]
//! pub struct Chooser {
//!     #[port(unlisted)]
//!     square: QueryClient<f64, f64>,
//!     #[property(default = "squares")]
//!     whom: String,
//! }
//!
//! impl Callbacks for Chooser {
//!     fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
//!         self.square.connect(&self.whom, "squares")?;
//!         self.square.query(3.0)?;
//!         self.square.disconnect()?;
//!         Ok(())
//!     }
//! }
//! ```
//!
//! A port belongs to its slot: connection and name outlive the instance, and a successor finds both as they were. Both begin
//! with `start`: an instance that is not in use yet, in `initialize` or as a spare, is answered `Disconnected`.

use super::{DataIn, EventClient, EventIn, PushClient, QueryClient, SendClient, StateMaster};
use crate::abi::host;
use crate::abi::links::{LinkApi, PortName, Reason};
use crate::abi::payload::PortHandle;
use crate::object::CommObject;
use crate::wiring::Refusal;

/// Implemented for the ends that ask or listen, and for no others.
pub(crate) mod sealed {
    use crate::abi::payload::PortHandle;

    /// The daemon's number of a port.
    pub trait Handled {
        /// That number.
        fn handle(&self) -> PortHandle;
    }
}

use sealed::Handled;

/// Connects itself, and chooses its name. Nothing here waits.
pub trait Requestor: Handled {
    /// Connects to a port of that slot. What this one was connected to before is disconnected first, and stays so where the
    /// two do not fit.
    ///
    /// # Errors
    /// `ServiceUnavailable`: there is no such slot, or it has no such port; `IncompatibleService`: pattern or objects differ;
    /// `Disconnected`: the instance is not in use, or not yet; `NotAllowed`: not in a callback; `Closed`; `Error`: others wire
    /// the same port all the time.
    fn connect(&mut self, slot: &str, port: &str) -> Result<(), Refusal> {
        let to = PortName { slot: slot.into(), port: port.into() };
        answer(|links, reason| (links.join)(self.handle(), to, reason))
    }

    /// Cuts its connections; whoever waits over one is told first. One that has none is no mistake.
    ///
    /// # Errors
    /// `Disconnected`, `NotAllowed`, `Closed`, `Error`, as for [`Self::connect`]. A query client is disconnected all the same.
    fn disconnect(&mut self) -> Result<(), Refusal> {
        answer(|links, reason| (links.part)(self.handle(), reason))
    }

    /// From now on others wire it by this name, and by no other that it had before. Its connections stay.
    ///
    /// # Errors
    /// `PortAlreadyUsed`: another port of the slot has that name; `Error`: it is no name (empty, with a dot, or longer than
    /// 118 bytes); `Disconnected`, `NotAllowed`, `Closed`, as for [`Self::connect`].
    fn add(&mut self, name: &str) -> Result<(), Refusal> {
        answer(|links, reason| (links.add)(self.handle(), name.into(), reason))
    }

    /// From now on others do not find it. Its connections stay. One that has no name is no mistake.
    ///
    /// # Errors
    /// `Disconnected`, `NotAllowed`, `Closed`, `Error`, as for [`Self::connect`].
    fn remove(&mut self) -> Result<(), Refusal> {
        answer(|links, reason| (links.remove)(self.handle(), reason))
    }
}

impl<P: Handled> Requestor for P {}

fn answer(call: impl FnOnce(&LinkApi, &mut Reason) -> u32) -> Result<(), Refusal> {
    let mut reason = Reason::NONE;
    Refusal::of(call(&host::get().links, &mut reason), &reason)
}

impl<T: CommObject> Handled for DataIn<T> {
    fn handle(&self) -> PortHandle {
        self.handle
    }
}

impl<T: CommObject> Handled for PushClient<T> {
    fn handle(&self) -> PortHandle {
        self.handle
    }
}

impl<R: CommObject, A: CommObject> Handled for QueryClient<R, A> {
    fn handle(&self) -> PortHandle {
        self.handle
    }
}

impl Handled for StateMaster {
    fn handle(&self) -> PortHandle {
        self.client.handle
    }
}

impl<C: CommObject> Handled for SendClient<C> {
    fn handle(&self) -> PortHandle {
        self.handle
    }
}

impl<P: CommObject, E: CommObject> Handled for EventClient<P, E> {
    fn handle(&self) -> PortHandle {
        self.handle
    }
}

impl<E: CommObject> Handled for EventIn<E> {
    fn handle(&self) -> PortHandle {
        self.handle
    }
}
