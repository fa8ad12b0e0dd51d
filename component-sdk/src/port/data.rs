//! Data ports: values from one writer to its readers.
//!
//! An input lends what it received (`newest`, `fresh`, `take` borrow the port) and the daemon holds the object
//! meanwhile. The alternative, a counted handle for each read, costs two atomic operations a read and leaks an object
//! whenever a callback is ended by a trap. Where an object must outlive the callback, clone it.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::time::Duration;

use crate::abi::payload::{self, PortHandle, ReadMode, Received};
use crate::context::Context;
use crate::object::CommObject;

/// What became of a value that was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Sent {
    /// Handed to every reader.
    Ok = 0,
    /// Nobody is connected.
    Unconnected = 1,
    /// At least one reader did not get it: its queue was full, or the value was outside its valid range.
    Dropped = 2,
    /// The port is closed: the instance was replaced.
    Closed = 3,
    /// The least time between two values, which the profile gives the port, was not over: nobody got it.
    TooEarly = 4,
    /// Of a [`PushTimedServer`](crate::port::PushTimedServer) only: it was not started.
    NotActivated = 5,
}

impl Sent {
    pub(crate) const fn from_code(code: u32) -> Self {
        match code {
            0 => Self::Ok,
            1 => Self::Unconnected,
            2 => Self::Dropped,
            4 => Self::TooEarly,
            5 => Self::NotActivated,
            _ => Self::Closed,
        }
    }
}

/// Receives objects of type `T`.
pub struct DataIn<T> {
    pub(super) handle: PortHandle,
    object: PhantomData<fn() -> T>,
}

impl<T: CommObject> Default for DataIn<T> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<T: CommObject> DataIn<T> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, object: PhantomData }
    }

    /// The newest value, read before or not; `None` before the first one.
    pub fn newest(&mut self) -> Option<&T> {
        self.read(ReadMode::Newest).map(Received::value)
    }

    /// The newest value, if it was not read before.
    pub fn fresh(&mut self) -> Option<&T> {
        self.read(ReadMode::Fresh).map(Received::value)
    }

    /// The next value of a FIFO, oldest first; on a port that keeps the newest only, the same as [`Self::fresh`].
    pub fn take(&mut self) -> Option<&T> {
        self.read(ReadMode::Take).map(Received::value)
    }

    /// How old the newest value is, measured from its writer's `write`; `None` before the first one.
    pub fn age(&mut self, cx: &Context<'_>) -> Option<Duration> {
        self.read(ReadMode::Newest).map(|received| cx.now().since(received.stamp()))
    }

    fn read(&mut self, mode: ReadMode) -> Option<Received<'_, T>> {
        payload::read(&mut self.handle, mode)
    }
}

/// Sends objects of type `T`, by value; immutable once sent, shared by reference among its readers.
pub struct DataOut<T> {
    handle: PortHandle,
    object: PhantomData<fn(T)>,
}

impl<T: CommObject> Default for DataOut<T> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<T: CommObject> DataOut<T> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, object: PhantomData }
    }

    /// Sends `value`. Never blocks.
    pub fn write(&mut self, value: T) -> Sent {
        match payload::loan(&mut self.handle) {
            Some(mut raw) => {
                *raw.value() = value;
                raw.publish()
            }
            None => Sent::Closed,
        }
    }

    /// Lends an object to be filled in place and sent: a recycled one, with its old contents and buffers, so that
    /// a large object is neither copied nor allocated anew. A loan that is dropped is not sent.
    ///
    /// # Panics
    /// When the instance was replaced and its port is closed.
    pub fn loan(&mut self) -> Loan<'_, T> {
        Loan { raw: payload::loan(&mut self.handle).expect("the port of a replaced instance is closed") }
    }
}

/// An object on loan from an output port.
pub struct Loan<'a, T: CommObject> {
    raw: payload::RawLoan<'a, T>,
}

impl<T: CommObject> Loan<'_, T> {
    /// Sends the object.
    #[allow(clippy::must_use_candidate, reason = "most senders do not ask who listened")]
    pub fn send(self) -> Sent {
        self.raw.publish()
    }
}

impl<T: CommObject> Deref for Loan<'_, T> {
    type Target = T;
    fn deref(&self) -> &T {
        self.raw.get()
    }
}

impl<T: CommObject> DerefMut for Loan<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        self.raw.value()
    }
}
