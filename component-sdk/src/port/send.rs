//! Send: a client tells a server something, and goes on.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Passes every other command on.
//! #[derive(Component)]
//! #[component(name = "Sieve", passive)]
//! pub struct Sieve {
//!     #[port(handler = on_command)]
//!     commands: SendServer<Twist>,
//!     #[port]
//!     passed: SendClient<Twist>,
//!     odd: bool,
//! }
//!
//! impl Callbacks for Sieve {}
//!
//! impl Sieve {
//!     fn on_command(&mut self, _: &mut Context<'_>, command: &Twist) -> Outcome {
//!         self.odd = !self.odd;
//!         if self.odd {
//!             self.passed.send(command.clone())?;
//!         }
//!         Ok(())
//!     }
//! }
//! ```
//!
//! What was sent lies in the server's queue and is its own: the sender may change, be wired to another server or fail, and
//! it is taken all the same, in the order in which this sender sent. `Ok` does not say that it was taken: who wants to
//! know asks by a [query](crate::port::QueryClient).

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::time::Duration;

use super::query::unless_panicking;
use crate::abi::calls::{self, CallLoan, CallRef, Wait, api};
use crate::abi::payload::PortHandle;
use crate::context::Context;
use crate::object::CommObject;
use crate::status::Status;

/// Sends to a [`SendServer`] of the same object.
pub struct SendClient<C> {
    pub(super) handle: PortHandle,
    object: PhantomData<fn(C)>,
}

impl<C: CommObject> Default for SendClient<C> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<C: CommObject> SendClient<C> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, object: PhantomData }
    }

    /// Puts it into the server's queue. Never waits.
    ///
    /// # Errors
    /// `Disconnected`, `Overload` (the server's queue is full, or as many of this port wait in it as its `<pending>`
    /// allows), `ProviderGone`, `ProviderStopped`, `ProviderReplaced`, `NotAllowed`, `Closed`. Nothing was sent then.
    pub fn send(&mut self, command: C) -> Result<(), Status> {
        let mut loan = self.loan()?;
        *loan = command;
        loan.send()
    }

    /// Lends an object to be filled in place and sent: a recycled one, with its old contents and buffers. One that is
    /// dropped is not sent.
    ///
    /// # Errors
    /// `Overload`, `NotAllowed`, `Closed`; `Disconnected` while the instance stands ready.
    pub fn loan(&mut self) -> Result<Outgoing<'_, C>, Status> {
        let lent = (api().loan)(self.handle);
        Ok(Outgoing { loan: Some(CallLoan::new(self.handle, &lent)?), port: PhantomData })
    }

    /// Whether this port may wait. It never does: this is here because every client has it, and changes nothing.
    ///
    /// # Errors
    /// `Closed`.
    pub fn blocking(&mut self, on: bool) -> Result<(), Status> {
        Status::check((api().blocking)(self.handle, calls::Whose::Port, on))
    }
}

/// An object on loan from a [`SendClient`].
pub struct Outgoing<'a, C: CommObject> {
    /// Nothing once it was sent.
    loan: Option<CallLoan<C>>,
    port: PhantomData<&'a mut SendClient<C>>,
}

impl<C: CommObject> Outgoing<'_, C> {
    /// Sends it.
    ///
    /// # Errors
    /// As [`SendClient::send`].
    pub fn send(mut self) -> Result<(), Status> {
        let call = self.loan.take().ok_or(Status::WrongId)?.call;
        Status::check((api().send)(call.port, call.id))
    }
}

impl<C: CommObject> Deref for Outgoing<'_, C> {
    type Target = C;
    fn deref(&self) -> &C {
        self.loan.as_ref().expect("only `send` takes it").get()
    }
}

impl<C: CommObject> DerefMut for Outgoing<'_, C> {
    fn deref_mut(&mut self) -> &mut C {
        self.loan.as_mut().expect("only `send` takes it").get_mut()
    }
}

impl<C: CommObject> Drop for Outgoing<'_, C> {
    fn drop(&mut self) {
        if let Some(loan) = &self.loan {
            (api().discard)(loan.call.port, loan.call.id);
        }
    }
}

/// Takes what any number of [`SendClient`]s send: in its handler, or where a port without a handler takes it by
/// [`Self::next`].
pub struct SendServer<C> {
    handle: PortHandle,
    object: PhantomData<fn(C)>,
}

impl<C: CommObject> Default for SendServer<C> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<C: CommObject> SendServer<C> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, object: PhantomData }
    }

    pub(crate) const fn handle(&self) -> PortHandle {
        self.handle
    }

    /// Takes what was sent next, and waits for it as long as it takes: until the component is to stop.
    ///
    /// # Errors
    /// `Cancelled` (the component is to stop, or may not wait here), `Overload` (as many held as the port's
    /// `<queue_size>` allows), `NotAllowed` (the port has a handler, which takes them), `Closed`.
    pub fn next<'a>(&mut self, _cx: &'a Context<'_>) -> Result<Message<'a, C>, Status> {
        self.taken(unless_panicking(Wait::DEFAULT)?)
    }

    /// As [`Self::next`], but waits no longer than `time`.
    ///
    /// # Errors
    /// As [`Self::next`], and `Timeout`.
    pub fn next_within<'a>(&mut self, _cx: &'a Context<'_>, time: Duration) -> Result<Message<'a, C>, Status> {
        self.taken(unless_panicking(Wait::within(time))?)
    }

    /// Takes what was sent next, if there is something.
    ///
    /// # Errors
    /// `NoData`, `Overload`, `NotAllowed`, `Closed`.
    pub fn try_next<'a>(&mut self, _cx: &'a Context<'_>) -> Result<Message<'a, C>, Status> {
        self.taken(Wait::NONE)
    }

    fn taken<'a>(&mut self, wait: Wait) -> Result<Message<'a, C>, Status> {
        calls::next(self.handle, wait).map(|(call, command)| Message::new(call, command))
    }
}

/// What was sent, where the sender wrote it. Its place is the sender's again when this is dropped.
pub struct Message<'a, C: CommObject> {
    call: CallRef,
    command: &'a C,
}

impl<'a, C: CommObject> Message<'a, C> {
    pub(crate) const fn new(call: CallRef, command: &'a C) -> Self {
        Self { call, command }
    }
}

impl<C: CommObject> Deref for Message<'_, C> {
    type Target = C;
    fn deref(&self) -> &C {
        self.command
    }
}

impl<C: CommObject + std::fmt::Debug> std::fmt::Debug for Message<'_, C> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.command.fmt(f)
    }
}

impl<C: CommObject> Drop for Message<'_, C> {
    /// Also where the handler panics: the same instance may go on, and would hold it for ever.
    fn drop(&mut self) {
        // Nobody waits for it: the status is for nobody.
        (api().refuse)(self.call.port, self.call.id, Status::Error.code());
    }
}
