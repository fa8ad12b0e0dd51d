//! Push: a server sends, each subscribed client keeps the newest.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Sends its count ten times a second, and hears every third of another one's.
//! #[derive(Component)]
//! #[component(name = "Beats", passive)]
//! pub struct Beats {
//!     #[port(timed = "100ms", handler = on_tick)]
//!     count: PushTimedServer<f64>,
//!     #[port]
//!     other: PushClient<f64>,
//!     beats: f64,
//! }
//!
//! impl Callbacks for Beats {
//!     fn start(&mut self, _: &mut Context<'_>) -> Outcome {
//!         self.other.subscribe(3)?;
//!         self.count.start()?;
//!         Ok(())
//!     }
//! }
//!
//! impl Beats {
//!     fn on_tick(&mut self, cx: &mut Context<'_>) -> Outcome {
//!         self.beats += 1.0;
//!         self.count.put(self.beats)?;
//!         if let Ok(other) = self.other.update() {
//!             info!(cx, "the other one is at {other}");
//!         }
//!         Ok(())
//!     }
//! }
//! ```
//!
//! A timed server without a cycle, or without the method that is called in each, is a mistake that the compiler finds:
//!
//! ```compile_fail
//! # use component_sdk::prelude::*;
//! #[derive(Component)]
//! #[component(name = "Idle", passive)]
//! pub struct Idle {
//!     #[port(timed = "100ms")]
//!     count: PushTimedServer<f64>,
//! }
//! ```
//!
//! Any server may be connected to any client, and both to data ports: a `DataIn` is subscribed by its connection, a `DataOut`
//! is a server that is always there. Profiles override what the class says: `<prescale>` of an input, `<period>` and
//! `<min_cycle>` of an output.
//!
//! Subscription, cycle and the value that is kept belong to the slot, not to the instance: the successor of one that failed
//! finds them as they were. They end when the slot is stopped, and when the port is disconnected.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::time::Duration;

use super::data::Sent;
use crate::abi::calls::{Wait, Whose};
use crate::abi::payload::{self, PortHandle};
use crate::abi::push::{self, api};
use crate::object::CommObject;
use crate::status::Status;

/// Who got a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivered {
    /// Every subscribed client whose turn it was.
    All,
    /// Not all of them: the queue of at least one was full, or the value was outside its valid range. The others have it.
    Some,
    /// Nobody is subscribed.
    Nobody,
    /// Nobody: the least time between two values was not over.
    TooEarly,
}

impl Delivered {
    const fn of(sent: Sent) -> Result<Self, Status> {
        match sent {
            Sent::Ok => Ok(Self::All),
            Sent::Unconnected => Ok(Self::Nobody),
            Sent::Dropped => Ok(Self::Some),
            Sent::TooEarly => Ok(Self::TooEarly),
            Sent::NotActivated => Err(Status::NotActivated),
            Sent::Closed => Err(Status::Closed),
        }
    }
}

/// Sends objects of type `T` to its subscribed clients.
pub struct PushServer<T> {
    handle: PortHandle,
    object: PhantomData<fn(T)>,
}

impl<T: CommObject> Default for PushServer<T> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<T: CommObject> PushServer<T> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, object: PhantomData }
    }

    /// Sends `value` at once, in this callback, to each subscribed client whose turn it is. Never waits.
    ///
    /// # Errors
    /// `Closed`.
    pub fn put(&mut self, value: T) -> Result<Delivered, Status> {
        put(&mut self.handle, value)
    }

    /// Lends an object to be filled in place and put: a recycled one, with its old contents and buffers. One that is dropped
    /// is not sent.
    ///
    /// # Errors
    /// `Closed`.
    pub fn loan(&mut self) -> Result<PushLoan<'_, T>, Status> {
        loan(&mut self.handle)
    }
}

/// Sends objects of type `T`, once in each cycle as a rule: a [`PushServer`] that its component starts and stops. While it
/// runs its handler is entered in each cycle, at once for the first time.
pub struct PushTimedServer<T> {
    handle: PortHandle,
    object: PhantomData<fn(T)>,
}

impl<T: CommObject> Default for PushTimedServer<T> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<T: CommObject> PushTimedServer<T> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, object: PhantomData }
    }

    pub(crate) const fn handle(&self) -> PortHandle {
        self.handle
    }

    /// Begins the cycle, and counts anew for every client: each gets the next value. Nothing happens where it runs already.
    ///
    /// # Errors
    /// `Disconnected`: the instance is not in use yet, as in `initialize`; `NotAllowed`, `Closed`.
    pub fn start(&mut self) -> Result<(), Status> {
        Status::check((api().start)(self.handle))
    }

    /// Ends the cycle. Clients that wait are told `NotActivated`, and what they have not looked at is dropped. Nothing
    /// happens where it does not run.
    ///
    /// # Errors
    /// `Disconnected`, `NotAllowed`, `Closed`.
    pub fn stop(&mut self) -> Result<(), Status> {
        Status::check((api().stop)(self.handle))
    }

    /// As [`PushServer::put`].
    ///
    /// # Errors
    /// `NotActivated`: it was not started; `Closed`.
    pub fn put(&mut self, value: T) -> Result<Delivered, Status> {
        put(&mut self.handle, value)
    }

    /// As [`PushServer::loan`].
    ///
    /// # Errors
    /// `Closed`.
    pub fn loan(&mut self) -> Result<PushLoan<'_, T>, Status> {
        loan(&mut self.handle)
    }
}

fn put<T: CommObject>(port: &mut PortHandle, value: T) -> Result<Delivered, Status> {
    let mut loan = loan(port)?;
    *loan = value;
    loan.put()
}

fn loan<T: CommObject>(port: &mut PortHandle) -> Result<PushLoan<'_, T>, Status> {
    payload::loan(port).map(|raw| PushLoan { raw }).ok_or(Status::Closed)
}

/// An object on loan from a server.
pub struct PushLoan<'a, T: CommObject> {
    raw: payload::RawLoan<'a, T>,
}

impl<T: CommObject> PushLoan<'_, T> {
    /// Sends the object.
    ///
    /// # Errors
    /// As [`PushServer::put`] or [`PushTimedServer::put`].
    pub fn put(self) -> Result<Delivered, Status> {
        Delivered::of(self.raw.publish())
    }
}

impl<T: CommObject> Deref for PushLoan<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        self.raw.get()
    }
}

impl<T: CommObject> DerefMut for PushLoan<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        self.raw.value()
    }
}

/// What a client is told of its server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Its cycle; zero where it has none.
    pub cycle: Duration,
    /// It sends what is put: always, where it has no cycle.
    pub running: bool,
}

/// Keeps the newest value of type `T` that its server put, while it is subscribed.
///
/// With `#[port(handler = on_value)]` a method is called with each value that arrives, with `prescale = n` beside it with
/// every n-th. Up to eight of them wait while the component is busy (`fifo = n`: so many), then the oldest make room.
pub struct PushClient<T> {
    pub(super) handle: PortHandle,
    object: PhantomData<fn() -> T>,
}

impl<T: CommObject> Default for PushClient<T> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<T: CommObject> PushClient<T> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, object: PhantomData }
    }

    pub(crate) const fn handle(&self) -> PortHandle {
        self.handle
    }

    /// Wants every `prescale`-th value from now on, the next one first. One that is subscribed stays so, with the prescale
    /// that it has.
    ///
    /// # Errors
    /// `Error`: a prescale of 0; `Disconnected`, `NotAllowed`, `Closed`.
    pub fn subscribe(&mut self, prescale: u32) -> Result<(), Status> {
        Status::check((api().subscribe)(self.handle, prescale))
    }

    /// Wants no values any more. The one that it has is dropped, and a wait ends with `Unsubscribed`.
    ///
    /// # Errors
    /// `Disconnected`: the instance is not in use yet; `NotAllowed`, `Closed`.
    pub fn unsubscribe(&mut self) -> Result<(), Status> {
        Status::check((api().unsubscribe)(self.handle))
    }

    /// The newest value, looked at before or not. Never one of an earlier subscription.
    ///
    /// # Errors
    /// `NoData`: none since it subscribed; `Unsubscribed`, `Disconnected`; `NotActivated`: its server has a cycle, and does
    /// not run; `NotAllowed`, `Closed`.
    pub fn update(&mut self) -> Result<&T, Status> {
        push::update(&mut self.handle, Wait::NONE)
    }

    /// Waits for the next value, whatever it has already, one second at most.
    ///
    /// # Errors
    /// `Timeout`, `Cancelled` (blocking is off), `Cycle` (its server waits for this component), `Unsubscribed`,
    /// `Disconnected`, `NotActivated`, `ProviderGone` (its server failed meanwhile, or is given up), `ProviderStopped`,
    /// `ProviderReplaced`, `NotAllowed`, `Closed`.
    pub fn update_wait(&mut self) -> Result<&T, Status> {
        self.wait(Wait::DEFAULT)
    }

    /// Waits for the next value, no longer than `time`.
    ///
    /// # Errors
    /// As [`Self::update_wait`].
    pub fn update_wait_within(&mut self, time: Duration) -> Result<&T, Status> {
        self.wait(Wait::within(time))
    }

    fn wait(&mut self, wait: Wait) -> Result<&T, Status> {
        // A wait in the middle of a panic would keep half-unwound frames for as long as it lasts.
        if std::thread::panicking() {
            return Err(Status::Cancelled);
        }
        push::update(&mut self.handle, wait)
    }

    /// Cycle and state of its server.
    ///
    /// # Errors
    /// `Disconnected`, `NotAllowed`, `Closed`.
    pub fn server_info(&mut self) -> Result<ServerInfo, Status> {
        let info = (api().info)(self.handle);
        Status::check(info.status)?;
        Ok(ServerInfo { cycle: Duration::from_nanos(info.period_ns), running: info.running })
    }

    /// Whether this port may wait. Off ends a wait that has begun with `Cancelled` and refuses new ones, until it is on
    /// again.
    ///
    /// # Errors
    /// `Disconnected`: the instance is not in use yet; `NotAllowed`, `Closed`.
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
