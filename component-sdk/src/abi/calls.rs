//! Calls crossing the border: the client's request and the server's answer lie in blocks of the client's port, which
//! both sides are lent in turn. Nothing is copied on the way.
//!
//! A call is known by a number on each side. A number that is stale, forged or of another port is answered
//! `Status::WrongId`, an instance that was replaced finds its ports `Status::Closed`.
#![allow(unsafe_code, reason = "address of unsafe: typed access to the blocks of a call")]

use std::marker::PhantomData;
use std::time::Duration;

use abi_stable::StableAbi;

use super::host;
use super::payload::PortHandle;
use crate::object::CommObject;
use crate::port::{Message, Query, QueryServer, SendServer};
use crate::status::Status;

/// How long to wait, in nanoseconds. 0: not at all; [`Wait::DEFAULT`]: as long as the port's profile says.
#[repr(transparent)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wait(pub u64);

impl Wait {
    /// Not at all.
    pub const NONE: Self = Self(0);
    /// As long as the port's profile says.
    pub const DEFAULT: Self = Self(u64::MAX);

    /// That long, and at least a moment: nothing at all would be another question.
    #[must_use]
    pub fn within(time: Duration) -> Self {
        Self(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX - 1).clamp(1, u64::MAX - 1))
    }
}

/// Whose gate is set.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Whose {
    /// The port's own.
    Port,
    /// The component's, which every client port has a copy of.
    Component,
}

/// An object on loan, or why there is none.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct Lent {
    /// Memory of the object's size and alignment; null with any status but 0.
    pub value: *mut u8,
    /// Number of the call.
    pub id: u64,
    /// 0, or the code of a [`Status`].
    pub status: u32,
    /// False: the memory holds no object yet.
    pub initialised: bool,
}

impl Lent {
    /// Nothing, for that reason.
    #[must_use]
    pub const fn refused(status: Status) -> Self {
        Self { value: std::ptr::null_mut(), id: 0, status: status.code(), initialised: false }
    }
}

/// What a handler is entered for.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServeKind {
    /// A query is to be answered.
    Request,
    /// What was sent is to be taken.
    Message,
    /// An activation of a client of events fired.
    Firing,
    /// A server of events has a new activation.
    Activation,
    /// An event arrived at an event port.
    Event,
    /// A value arrived at a push client.
    Value,
    /// The cycle of a timed server begins.
    Tick,
}

/// What [`Hook::Serve`](super::class::Hook::Serve) is entered with.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct ServeArgs {
    /// The instance's port. Not its place in the class: a secondary may declare its ports in another order.
    pub port: PortHandle,
    /// What it is entered for.
    pub what: ServeKind,
    /// The server's number of the call, the client's number of the activation.
    pub id: u64,
    /// The request, what was sent, the value, the event, or the parameter of an activation.
    pub value: *const u8,
}

// SAFETY: the object is `Send + Sync` (supertraits of `CommObject`), and only the handler's callback looks at it.
unsafe impl Send for ServeArgs {}

impl ServeArgs {
    /// Nothing to serve.
    pub const NONE: Self =
        Self { port: PortHandle(std::ptr::null()), what: ServeKind::Request, id: 0, value: std::ptr::null() };
}

/// The functions of the daemon that make up the query and the send pattern. All of them belong into a callback of the instance whose
/// port it is; on a thread of its own a component gets [`Status::NotAllowed`].
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct CallApi {
    /// Client: lends a call and the block for its request, or for what is to be sent.
    pub loan: extern "C" fn(port: PortHandle) -> Lent,
    /// Client: sends what is on loan. With the send pattern the call is the server's from then on.
    pub send: extern "C" fn(port: PortHandle, id: u64) -> u32,
    /// Client: sends the request on loan and waits for the answer. Whatever else comes ends the call.
    pub ask: extern "C" fn(port: PortHandle, id: u64, wait: Wait) -> Lent,
    /// Client: lends the answer, waits for it if asked to.
    pub receive: extern "C" fn(port: PortHandle, id: u64, wait: Wait) -> Lent,
    /// Client: gives an answer on loan back.
    pub release: extern "C" fn(port: PortHandle, id: u64),
    /// Client: gives a call up, sent or not.
    pub discard: extern "C" fn(port: PortHandle, id: u64) -> u32,
    /// Client: whether this port may wait, for itself or as one of its component's.
    pub blocking: extern "C" fn(port: PortHandle, whose: Whose, on: bool) -> u32,
    /// Server: wakes whatever of its component waits, to look at its conditions again.
    pub wake: extern "C" fn(port: PortHandle) -> u32,
    /// Server: takes the next call of a port without a handler, waits for it if asked to.
    pub next: extern "C" fn(port: PortHandle, wait: Wait) -> Lent,
    /// Server: the request of a call that it holds.
    pub opened: extern "C" fn(port: PortHandle, id: u64) -> Lent,
    /// Server: lends the block for the answer.
    pub answer_loan: extern "C" fn(port: PortHandle, id: u64) -> Lent,
    /// Server: sends the answer on loan.
    pub answer: extern "C" fn(port: PortHandle, id: u64) -> u32,
    /// Server: lets a call go unanswered; the client gets the status of that code. With the send pattern it is done with
    /// what was sent, and nobody gets anything.
    pub refuse: extern "C" fn(port: PortHandle, id: u64, status: u32) -> u32,
}

impl CallApi {
    /// Where there is no daemon: every port is closed.
    pub const CLOSED: Self = Self {
        loan: closed::lent,
        send: closed::code,
        ask: closed::waited,
        receive: closed::waited,
        release: closed::released,
        discard: closed::code,
        blocking: closed::blocking,
        wake: closed::wake,
        next: closed::next,
        opened: closed::lent_call,
        answer_loan: closed::lent_call,
        answer: closed::code,
        refuse: closed::refused,
    };
}

mod closed {
    use super::{Lent, PortHandle, Status, Wait, Whose};

    const CODE: u32 = Status::Closed.code();

    pub(super) extern "C" fn lent(_: PortHandle) -> Lent {
        Lent::refused(Status::Closed)
    }
    pub(super) extern "C" fn lent_call(_: PortHandle, _: u64) -> Lent {
        Lent::refused(Status::Closed)
    }
    pub(super) extern "C" fn waited(_: PortHandle, _: u64, _: Wait) -> Lent {
        Lent::refused(Status::Closed)
    }
    pub(super) extern "C" fn code(_: PortHandle, _: u64) -> u32 {
        CODE
    }
    pub(super) extern "C" fn wake(_: PortHandle) -> u32 {
        CODE
    }
    pub(super) extern "C" fn released(_: PortHandle, _: u64) {}
    pub(super) extern "C" fn blocking(_: PortHandle, _: Whose, _: bool) -> u32 {
        CODE
    }
    pub(super) extern "C" fn next(_: PortHandle, _: Wait) -> Lent {
        Lent::refused(Status::Closed)
    }
    pub(super) extern "C" fn refused(_: PortHandle, _: u64, _: u32) -> u32 {
        CODE
    }
}

/// One end of a call, as plugin code holds it: the port and the number there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CallRef {
    pub(crate) port: PortHandle,
    pub(crate) id: u64,
}

/// A block of a call on loan: holds a valid `T`, exclusively.
pub(crate) struct CallLoan<T> {
    pub(crate) call: CallRef,
    value: *mut T,
    object: PhantomData<T>,
}

impl<T: CommObject> CallLoan<T> {
    /// The block that the daemon lent; in one that is still empty an empty object is made.
    ///
    /// # Errors
    /// The status with which nothing was lent.
    pub(crate) fn new(port: PortHandle, lent: &Lent) -> Result<Self, Status> {
        Status::check(lent.status)?;
        let value = lent.value.cast::<T>();
        if !lent.initialised {
            // SAFETY: with status 0 the daemon lends memory of the size and alignment that the port's descriptor,
            // which is `T`'s, asks for, to one borrower at a time; it holds no object yet.
            unsafe { value.write(T::empty()) };
        }
        Ok(Self { call: CallRef { port, id: lent.id }, value, object: PhantomData })
    }

    pub(crate) fn get(&self) -> &T {
        // SAFETY: `new` made sure that a valid `T` is there; the call stays with this side until it is sent, released
        // or let go, each of which ends the loan.
        unsafe { &*self.value }
    }

    pub(crate) fn get_mut(&mut self) -> &mut T {
        // SAFETY: as in `get`; `&mut self` makes the access exclusive.
        unsafe { &mut *self.value }
    }
}

/// What came with a call that this server holds, for as long as the handler or the borrow of its token lasts.
pub(crate) fn request_of<'a, R: CommObject>(value: *const u8) -> Option<&'a R> {
    // SAFETY: the daemon compared the layouts of `R` at both ends when they were connected, shows a server only requests
    // that their clients have filled, and keeps the block alive and unwritten until this server lets the call go. The
    // callers bind the borrow to the callback in which the daemon showed it.
    unsafe { value.cast::<R>().as_ref() }
}

/// What a component is to serve; `#[derive(Component)]` writes the code that looks at it.
pub struct Incoming<'a> {
    args: &'a ServeArgs,
}

impl<'a> Incoming<'a> {
    pub(crate) const fn new(args: &'a ServeArgs) -> Self {
        Self { args }
    }

    /// Number and object of what came in, if it is of that kind and came in at that port.
    pub(crate) fn at(&self, what: ServeKind, port: PortHandle) -> Option<(u64, *const u8)> {
        (self.args.what == what && self.args.port == port).then_some((self.args.id, self.args.value))
    }

    /// What was sent, if it came in at this port.
    #[must_use]
    pub fn message<C: CommObject>(&self, server: &SendServer<C>) -> Option<Message<'a, C>> {
        let port = server.handle();
        let (id, value) = self.at(ServeKind::Message, port)?;
        let command = request_of(value)?;
        Some(Message::new(CallRef { port, id }, command))
    }

    pub(crate) const fn args(&self) -> &'a ServeArgs {
        self.args
    }

    /// The query, if it came in at this port.
    #[must_use]
    pub fn query<R: CommObject, A: CommObject>(&self, server: &QueryServer<R, A>) -> Option<Query<'a, R, A>> {
        let port = server.handle();
        let (id, value) = self.at(ServeKind::Request, port)?;
        let request = request_of(value)?;
        Some(Query::new(CallRef { port, id }, request))
    }
}

/// The next call of a server's port, and what came with it.
///
/// # Errors
/// The status with which nothing was taken.
pub(crate) fn next<'a, R: CommObject>(port: PortHandle, wait: Wait) -> Result<(CallRef, &'a R), Status> {
    let lent = (api().next)(port, wait);
    Status::check(lent.status)?;
    let request = request_of(lent.value).ok_or(Status::Error)?;
    Ok((CallRef { port, id: lent.id }, request))
}

/// Functions of the daemon, by their names.
pub(crate) fn api() -> &'static CallApi {
    &host::get().calls
}
