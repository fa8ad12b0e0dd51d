//! Event: a client says once what it wants to hear of, a server tests that whenever its state changes, and tells.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Where a level is crossed.
//! #[repr(C)]
//! #[derive(CommObject, Clone, Debug, Default)]
//! pub struct Threshold {
//!     /// The level.
//!     pub above: f64,
//!     /// The server's memory: it was above when it was tested last.
//!     pub was: bool,
//! }
//!
//! /// Hears of crossings, and tells others of its own.
//! #[derive(Component)]
//! #[component(name = "Watcher", periodic = "20ms")]
//! pub struct Watcher {
//!     #[port(handler = on_crossing)]
//!     level: EventClient<Threshold, f64>,
//!     #[port]
//!     crossings: EventServer<Threshold, f64, Pose2D>,
//!     pose: Pose2D,
//! }
//!
//! impl Callbacks for Watcher {
//!     fn start(&mut self, _: &mut Context<'_>) -> Outcome {
//!         self.level.activate(Mode::Continuous, Threshold { above: 3.0, was: false })?;
//!         Ok(())
//!     }
//!
//!     fn on_execute(&mut self, _: &mut Context<'_>) -> Outcome {
//!         self.pose.x += 0.1;
//!         self.crossings.put(&self.pose, |parameter, event, pose| {
//!             let crosses = pose.x > parameter.above && !parameter.was;
//!             parameter.was = pose.x > parameter.above;
//!             *event = pose.x;
//!             crosses
//!         })?;
//!         Ok(())
//!     }
//! }
//!
//! impl Watcher {
//!     fn on_crossing(&mut self, cx: &mut Context<'_>, _: EventId<f64>, level: &f64) -> Outcome {
//!         info!(cx, "crossed at {level}");
//!         Ok(())
//!     }
//! }
//! ```
//!
//! Each activation has one place for its event, where a later one takes the place of an earlier one that was not fetched; a
//! handler gets every one, in order, besides. [`EventOut`] and [`EventIn`] are the plain form of OPRoS: whoever is connected
//! gets every event.

use std::marker::PhantomData;
use std::time::Duration;

use super::data::{DataIn, DataOut, Loan, Sent};
use crate::abi::calls::{CallLoan, Wait, Whose};
use crate::abi::events::{self, Mode, Which, api};
use crate::abi::payload::PortHandle;
use crate::object::CommObject;
use crate::status::Status;

/// Is told of events by an [`EventServer`] of the same objects: `P` says of which, `E` is what happened.
pub struct EventClient<P, E> {
    pub(crate) handle: PortHandle,
    objects: PhantomData<fn(P) -> E>,
}

/// One activation of an [`EventClient`], until it is deactivated.
pub struct EventId<E> {
    id: u64,
    event: PhantomData<fn() -> E>,
}

impl<E> EventId<E> {
    pub(crate) const fn new(id: u64) -> Self {
        Self { id, event: PhantomData }
    }

    pub(crate) const fn number(self) -> u64 {
        self.id
    }
}

impl<E> Clone for EventId<E> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<E> Copy for EventId<E> {}

impl<E> std::fmt::Debug for EventId<E> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("EventId").field(&self.id).finish()
    }
}

impl<E> PartialEq for EventId<E> {
    fn eq(&self, other: &Self) -> bool {
        self.id == other.id
    }
}

impl<E> Eq for EventId<E> {}

/// How far an activation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventState {
    /// It waits for its event.
    Active,
    /// It fired, and the event was not fetched.
    Fired,
    /// A single one: it fired, and the event was fetched.
    Passive,
}

impl<P: CommObject, E: CommObject> Default for EventClient<P, E> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<P: CommObject, E: CommObject> EventClient<P, E> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, objects: PhantomData }
    }

    pub(crate) const fn handle(&self) -> PortHandle {
        self.handle
    }

    /// Asks to be told of events. The server keeps the parameter for this activation, and may change it.
    ///
    /// # Errors
    /// `Disconnected`, `Overload` (as many activations as the port's `<activations>` allows), `ProviderGone`,
    /// `ProviderStopped`, `ProviderReplaced`, `NotAllowed`, `Closed`.
    pub fn activate(&mut self, mode: Mode, parameter: P) -> Result<EventId<E>, Status> {
        let mut loan = CallLoan::<P>::new(self.handle, &(api().loan)(self.handle))?;
        *loan.get_mut() = parameter;
        Status::check((api().activate)(self.handle, loan.call.id, mode))?;
        Ok(EventId::new(loan.call.id))
    }

    /// Asks not to be told any more. A single activation needs it, too, after it has fired.
    ///
    /// # Errors
    /// `WrongId`, `NotAllowed`, `Closed`.
    pub fn deactivate(&mut self, id: EventId<E>) -> Result<(), Status> {
        Status::check((api().deactivate)(self.handle, id.id))
    }

    /// How far an activation is. Fetches nothing.
    ///
    /// # Errors
    /// `WrongId`, `NotAllowed`, `Closed`.
    pub fn try_event(&mut self, id: EventId<E>) -> Result<EventState, Status> {
        match Status::check((api().state)(self.handle, id.id)) {
            Ok(()) => Ok(EventState::Fired),
            Err(Status::Active) => Ok(EventState::Active),
            Err(Status::Passive) => Ok(EventState::Passive),
            Err(status) => Err(status),
        }
    }

    /// Fetches the event that is there, or waits for the next one.
    ///
    /// # Errors
    /// `Passive` (a single one that was fetched already), `WrongId`; of a wait: `Cancelled` (blocking is off), `Timeout`,
    /// `Cycle`, `ProviderGone`, `ProviderStopped`, after which the id stays valid; `NotActivated`, `Disconnected`,
    /// `ProviderReplaced`, after which it is not; `NotAllowed`, `Closed`.
    pub fn get_event(&mut self, id: EventId<E>) -> Result<&E, Status> {
        self.fetch(id, Which::Present, Wait::DEFAULT)
    }

    /// As [`Self::get_event`], but waits no longer than `time`.
    ///
    /// # Errors
    /// As [`Self::get_event`].
    pub fn get_event_within(&mut self, id: EventId<E>, time: Duration) -> Result<&E, Status> {
        self.fetch(id, Which::Present, Wait::within(time))
    }

    /// Waits for the next event, whatever is there. A single one that fired already has no next.
    ///
    /// # Errors
    /// As [`Self::get_event`].
    pub fn get_next_event(&mut self, id: EventId<E>) -> Result<&E, Status> {
        self.fetch(id, Which::Next, Wait::DEFAULT)
    }

    /// As [`Self::get_next_event`], but waits no longer than `time`.
    ///
    /// # Errors
    /// As [`Self::get_event`].
    pub fn get_next_event_within(&mut self, id: EventId<E>, time: Duration) -> Result<&E, Status> {
        self.fetch(id, Which::Next, Wait::within(time))
    }

    fn fetch(&mut self, id: EventId<E>, which: Which, wait: Wait) -> Result<&E, Status> {
        // A wait in the middle of a panic would keep half-unwound frames for as long as it lasts.
        let wait = if std::thread::panicking() { Wait::NONE } else { wait };
        match events::fetched(&(api().fetch)(self.handle, id.id, which, wait)) {
            Err(Status::NoData) => Err(Status::Cancelled),
            fetched => fetched,
        }
    }

    /// Whether this port may wait. Off ends the waits that have begun with `Cancelled` and refuses new ones, until it is
    /// on again. An event that is there already is given out all the same.
    ///
    /// # Errors
    /// `Closed`.
    pub fn blocking(&mut self, on: bool) -> Result<(), Status> {
        Status::check((api().blocking)(self.handle, Whose::Port, on))
    }

    /// For the derives: the component's gate.
    #[doc(hidden)]
    pub fn component_blocking(&mut self, on: bool) {
        // A port that is closed waits for nothing.
        (api().blocking)(self.handle, Whose::Component, on);
    }
}

/// Tells any number of [`EventClient`]s of events: `P` is what a client asks for, `E` what it gets, `S` what is tested.
pub struct EventServer<P, E, S: ?Sized = E> {
    handle: PortHandle,
    objects: PhantomData<fn(P, &S) -> E>,
}

impl<P: CommObject, E: CommObject, S: ?Sized> Default for EventServer<P, E, S> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<P: CommObject, E: CommObject, S: ?Sized> EventServer<P, E, S> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, objects: PhantomData }
    }

    pub(crate) const fn handle(&self) -> PortHandle {
        self.handle
    }

    /// Tests every activation of every client against `state`: where `test` is true, that activation fires with the event.
    /// The parameter is that activation's own and may be changed, to remember what was; the event is empty each time. An
    /// activation that fires once is tested further, but told no more.
    ///
    /// # Errors
    /// `Overload`: a client's queue was full and lost an event; all others have theirs. `NotAllowed`, `Closed`.
    pub fn put(&mut self, state: &S, test: impl FnMut(&mut P, &mut E, &S) -> bool) -> Result<(), Status> {
        events::put(self.handle, state, test)
    }
}

/// Sends events to every [`EventIn`] that is connected.
pub struct EventOut<E>(DataOut<E>);

impl<E: CommObject> Default for EventOut<E> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<E: CommObject> EventOut<E> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self(DataOut::new(handle))
    }

    /// Sends an event. Never blocks.
    pub fn send(&mut self, event: E) -> Sent {
        self.0.write(event)
    }

    /// Lends an event to be filled in place and sent: a recycled one, with its old contents and buffers. One that is dropped
    /// is not sent.
    ///
    /// # Panics
    /// When the instance was replaced and its port is closed.
    pub fn loan(&mut self) -> Loan<'_, E> {
        self.0.loan()
    }
}

/// Receives every event of every [`EventOut`] that is connected, in order. Its handler is entered for each; without one,
/// [`on_event`](crate::component::Callbacks::on_event) is, and takes them.
pub struct EventIn<E> {
    pub(crate) handle: PortHandle,
    events: DataIn<E>,
}

impl<E: CommObject> Default for EventIn<E> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<E: CommObject> EventIn<E> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, events: DataIn::new(handle) }
    }

    pub(crate) const fn handle(&self) -> PortHandle {
        self.handle
    }

    /// The next event, oldest first.
    pub fn take(&mut self) -> Option<&E> {
        self.events.take()
    }
}
