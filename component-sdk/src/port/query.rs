//! Query: a client asks, a server answers, many questions may be open at once.
//!
//! ```
//! use component_sdk::prelude::*;
//!
//! /// Asks another component to square a number, and squares numbers for others.
//! #[derive(Component)]
//! #[component(name = "Squares", passive)]
//! pub struct Squares {
//!     #[port]
//!     square: QueryClient<f64, f64>,
//!     #[port(handler = on_square)]
//!     squares: QueryServer<f64, f64>,
//! }
//!
//! impl Callbacks for Squares {
//!     fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
//!         let nine = *self.square.query(3.0)?;
//!         info!(cx, "{nine}");
//!         Ok(())
//!     }
//! }
//!
//! impl Squares {
//!     fn on_square(&mut self, _: &mut Context<'_>, query: Query<'_, f64, f64>) -> Outcome {
//!         let number = *query;
//!         query.answer(number * number)?;
//!         Ok(())
//!     }
//! }
//! ```
//!
//! A server without a handler takes its queries itself, when it likes:
//!
//! ```
//! # use component_sdk::prelude::*;
//! /// Squares one number in each period.
//! #[derive(Component)]
//! #[component(name = "Slow", periodic = "100ms")]
//! pub struct Slow {
//!     #[port]
//!     squares: QueryServer<f64, f64>,
//! }
//!
//! impl Callbacks for Slow {
//!     fn on_execute(&mut self, cx: &mut Context<'_>) -> Outcome {
//!         let query = self.squares.next(cx)?;
//!         let number = *query;
//!         query.answer(number * number)?;
//!         Ok(())
//!     }
//! }
//! ```
//!
//! A handler that is not there is a mistake that the compiler finds:
//!
//! ```compile_fail
//! # use component_sdk::prelude::*;
//! #[derive(Component)]
//! #[component(name = "Deaf", passive)]
//! pub struct Deaf {
//!     #[port(handler = on_square)]
//!     squares: QueryServer<f64, f64>,
//! }
//! # impl Callbacks for Deaf {}
//! ```
//!
//! A wait suspends the callback, not the thread: other components run meanwhile. It ends by the answer, by its deadline
//! (the port's `<timeout>`, one second where the profile says nothing), or by a [`Status`] that says what came between.
//! While a callback waits, its component is entered by no other one.

use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::time::Duration;

use crate::abi::calls::{self, CallLoan, CallRef, Lent, Wait, Whose, api};
use crate::abi::payload::PortHandle;
use crate::context::Context;
use crate::object::CommObject;
use crate::status::Status;

/// Asks a [`QueryServer`] of the same objects: `R` is the request, `A` the answer.
pub struct QueryClient<R, A> {
    pub(super) handle: PortHandle,
    objects: PhantomData<fn(R) -> A>,
}

/// One question of a [`QueryClient`], between `request` and `receive` or `discard`.
pub struct QueryId<A> {
    id: u64,
    answer: PhantomData<fn() -> A>,
}

impl<A> Clone for QueryId<A> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<A> Copy for QueryId<A> {}

impl<A> std::fmt::Debug for QueryId<A> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("QueryId").field(&self.id).finish()
    }
}

impl<A> PartialEq for QueryId<A> {
    fn eq(&self, other: &Self) -> bool {
        self.id == other.id
    }
}

impl<A> Eq for QueryId<A> {}

impl<R: CommObject, A: CommObject> Default for QueryClient<R, A> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<R: CommObject, A: CommObject> QueryClient<R, A> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, objects: PhantomData }
    }

    /// Asks, and waits for the answer.
    ///
    /// # Errors
    /// `Disconnected`, `Cancelled` (blocking is off), `Timeout`, `Cycle`, `Overload`, `ProviderGone`,
    /// `ProviderStopped`, `ProviderReplaced`, `Error` (let go unanswered), `NotAllowed`, `Closed`. Whatever it is, the
    /// question is over.
    pub fn query(&mut self, request: R) -> Result<Reply<'_, A>, Status> {
        self.filled(request)?.ask(Wait::DEFAULT)
    }

    /// As [`Self::query`], but waits no longer than `time`.
    ///
    /// # Errors
    /// As [`Self::query`].
    pub fn query_within(&mut self, request: R, time: Duration) -> Result<Reply<'_, A>, Status> {
        self.filled(request)?.ask(Wait::within(time))
    }

    /// Asks, and returns at once. The answer is there for [`Self::receive`] until it is fetched or discarded.
    ///
    /// # Errors
    /// `Disconnected`, `Overload` (as many questions open as the port's `<pending>` allows, or the server's queue is
    /// full), `ProviderGone`, `ProviderStopped`, `ProviderReplaced`, `NotAllowed`, `Closed`.
    pub fn request(&mut self, request: R) -> Result<QueryId<A>, Status> {
        self.filled(request)?.request()
    }

    /// Lends a request to be filled in place: a recycled one, with its old contents and buffers. One that is dropped is
    /// not sent.
    ///
    /// # Errors
    /// `Overload`, `NotAllowed`, `Closed`.
    pub fn loan(&mut self) -> Result<Request<'_, R, A>, Status> {
        let lent = (api().loan)(self.handle);
        let loan = CallLoan::new(self.handle, &lent)?;
        Ok(Request { loan: Some(loan), port: PhantomData })
    }

    fn filled(&mut self, request: R) -> Result<Request<'_, R, A>, Status> {
        let mut loan = self.loan()?;
        *loan = request;
        Ok(loan)
    }

    /// The answer, if it is there.
    ///
    /// # Errors
    /// `NoData` (not yet; the id stays valid) and `WrongId`; the id is used up by `Disconnected`, `ProviderGone`,
    /// `ProviderStopped`, `ProviderReplaced`, `Error`; `NotAllowed`, `Closed`.
    pub fn receive(&mut self, id: QueryId<A>) -> Result<Reply<'_, A>, Status> {
        self.receive_by(id, Wait::NONE)
    }

    /// Waits for the answer.
    ///
    /// # Errors
    /// As [`Self::receive`]; `Cancelled`, `Timeout` and `Cycle` instead of `NoData`, after which the id stays valid.
    pub fn receive_wait(&mut self, id: QueryId<A>) -> Result<Reply<'_, A>, Status> {
        self.receive_by(id, Wait::DEFAULT)
    }

    /// Waits for the answer, no longer than `time`.
    ///
    /// # Errors
    /// As [`Self::receive_wait`].
    pub fn receive_wait_within(&mut self, id: QueryId<A>, time: Duration) -> Result<Reply<'_, A>, Status> {
        self.receive_by(id, Wait::within(time))
    }

    fn receive_by(&mut self, id: QueryId<A>, wait: Wait) -> Result<Reply<'_, A>, Status> {
        let wait = if wait != Wait::NONE { unless_panicking(wait)? } else { wait };
        Reply::new(self.handle, &(api().receive)(self.handle, id.id, wait))
    }

    /// Gives a question up. Its answer, if it still comes, is dropped.
    ///
    /// # Errors
    /// `WrongId`, `NotAllowed`, `Closed`.
    pub fn discard(&mut self, id: QueryId<A>) -> Result<(), Status> {
        Status::check((api().discard)(self.handle, id.id))
    }

    /// Whether this port may wait. Off ends the waits that have begun with `Cancelled` and refuses new ones, until it is
    /// on again. An answer that is there already is given out all the same.
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

/// A wait in the middle of a panic would keep half-unwound frames for as long as it lasts.
pub(super) fn unless_panicking(wait: Wait) -> Result<Wait, Status> {
    if std::thread::panicking() { Err(Status::Cancelled) } else { Ok(wait) }
}

/// A request on loan from a [`QueryClient`].
pub struct Request<'a, R: CommObject, A: CommObject> {
    /// Nothing once it was sent.
    loan: Option<CallLoan<R>>,
    port: PhantomData<&'a mut QueryClient<R, A>>,
}

impl<'a, R: CommObject, A: CommObject> Request<'a, R, A> {
    /// Sends it, and waits for the answer.
    ///
    /// # Errors
    /// As [`QueryClient::query`].
    pub fn query(self) -> Result<Reply<'a, A>, Status> {
        self.ask(Wait::DEFAULT)
    }

    /// Sends it, and waits for the answer no longer than `time`.
    ///
    /// # Errors
    /// As [`QueryClient::query`].
    pub fn query_within(self, time: Duration) -> Result<Reply<'a, A>, Status> {
        self.ask(Wait::within(time))
    }

    /// Sends it, and returns at once.
    ///
    /// # Errors
    /// As [`QueryClient::request`].
    pub fn request(mut self) -> Result<QueryId<A>, Status> {
        let call = self.sent();
        Status::check((api().send)(call.port, call.id))?;
        Ok(QueryId { id: call.id, answer: PhantomData })
    }

    fn ask(mut self, wait: Wait) -> Result<Reply<'a, A>, Status> {
        let wait = unless_panicking(wait)?;
        let call = self.sent();
        Reply::new(call.port, &(api().ask)(call.port, call.id, wait))
    }

    /// The call, which is the daemon's from now on.
    fn sent(&mut self) -> CallRef {
        self.loan.take().expect("a request is sent once, by a method that consumes it").call
    }
}

impl<R: CommObject, A: CommObject> Deref for Request<'_, R, A> {
    type Target = R;
    fn deref(&self) -> &R {
        self.loan.as_ref().expect("only `sent` takes it").get()
    }
}

impl<R: CommObject, A: CommObject> DerefMut for Request<'_, R, A> {
    fn deref_mut(&mut self) -> &mut R {
        self.loan.as_mut().expect("only `sent` takes it").get_mut()
    }
}

impl<R: CommObject, A: CommObject> Drop for Request<'_, R, A> {
    fn drop(&mut self) {
        if let Some(loan) = &self.loan {
            (api().discard)(loan.call.port, loan.call.id);
        }
    }
}

/// An answer, where the server wrote it. Given back when it is dropped.
pub struct Reply<'a, A: CommObject> {
    loan: CallLoan<A>,
    port: PhantomData<&'a mut PortHandle>,
}

impl<A: CommObject> Reply<'_, A> {
    fn new(port: PortHandle, lent: &Lent) -> Result<Self, Status> {
        Ok(Self { loan: CallLoan::new(port, lent)?, port: PhantomData })
    }

    /// Moves the answer out.
    #[must_use]
    pub fn take(mut self) -> A {
        std::mem::replace(self.loan.get_mut(), A::empty())
    }
}

impl<A: CommObject> Deref for Reply<'_, A> {
    type Target = A;
    fn deref(&self) -> &A {
        self.loan.get()
    }
}

impl<A: CommObject + std::fmt::Debug> std::fmt::Debug for Reply<'_, A> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.loan.get().fmt(f)
    }
}

impl<A: CommObject> Drop for Reply<'_, A> {
    fn drop(&mut self) {
        (api().release)(self.loan.call.port, self.loan.call.id);
    }
}

/// Answers the queries of any number of [`QueryClient`]s: in its handler, later, or where a port without a handler takes
/// them by [`Self::next`].
pub struct QueryServer<R, A> {
    handle: PortHandle,
    objects: PhantomData<fn(R) -> A>,
}

impl<R: CommObject, A: CommObject> Default for QueryServer<R, A> {
    /// A closed one: what is left where a port was taken to be moved into a task.
    fn default() -> Self {
        Self::new(PortHandle::CLOSED)
    }
}

impl<R: CommObject, A: CommObject> QueryServer<R, A> {
    pub(crate) const fn new(handle: PortHandle) -> Self {
        Self { handle, objects: PhantomData }
    }

    pub(crate) const fn handle(&self) -> PortHandle {
        self.handle
    }

    /// Takes the next query, and waits for it as long as it takes: until the component is to stop.
    ///
    /// # Errors
    /// `Cancelled` (the component is to stop, or may not wait here), `Overload` (as many queries kept as the port's
    /// `<queue_size>` allows), `NotAllowed` (the port has a handler, which takes them), `Closed`.
    pub fn next<'a>(&mut self, _cx: &'a Context<'_>) -> Result<Query<'a, R, A>, Status> {
        self.taken(unless_panicking(Wait::DEFAULT)?)
    }

    /// As [`Self::next`], but waits no longer than `time`.
    ///
    /// # Errors
    /// As [`Self::next`], and `Timeout`.
    pub fn next_within<'a>(&mut self, _cx: &'a Context<'_>, time: Duration) -> Result<Query<'a, R, A>, Status> {
        self.taken(unless_panicking(Wait::within(time))?)
    }

    /// Takes the next query, if there is one.
    ///
    /// # Errors
    /// `NoData`, `Overload`, `NotAllowed`, `Closed`.
    pub fn try_next<'a>(&mut self, _cx: &'a Context<'_>) -> Result<Query<'a, R, A>, Status> {
        self.taken(Wait::NONE)
    }

    fn taken<'a>(&mut self, wait: Wait) -> Result<Query<'a, R, A>, Status> {
        calls::next(self.handle, wait).map(|(call, request)| Query::new(call, request))
    }
}

/// A query that was taken: reads as the request. One that is dropped unanswered ends with `Status::Error` at the client.
pub struct Query<'a, R: CommObject, A: CommObject> {
    request: &'a R,
    // Whole until the query is answered, refused or kept.
    token: Option<Pending<R, A>>,
}

impl<'a, R: CommObject, A: CommObject> Query<'a, R, A> {
    pub(crate) const fn new(call: CallRef, request: &'a R) -> Self {
        Self { request, token: Some(Pending { call: Some(call), objects: PhantomData }) }
    }

    /// Answers.
    ///
    /// # Errors
    /// `Disconnected` (the client has left; the answer is dropped), `WrongId` (the call was ended meanwhile),
    /// `NotAllowed`, `Closed`.
    pub fn answer(mut self, answer: A) -> Result<(), Status> {
        self.token().answer(answer)
    }

    /// Lends the answer to be filled in place and sent: a recycled one, with its old contents and buffers.
    ///
    /// # Errors
    /// As [`Self::answer`].
    pub fn loan(mut self) -> Result<Answer<'a, A>, Status> {
        self.token().lend()
    }

    /// Answers with a status, which the client gets instead of an answer.
    ///
    /// # Errors
    /// As [`Self::answer`].
    pub fn refuse(mut self, status: Status) -> Result<(), Status> {
        self.token().refuse(status)
    }

    /// Keeps the query, to be answered from a later callback. Until then it is one of those that its client's `<pending>` allows,
    /// also where the client has given it up: one that is kept for ever takes that place for ever.
    #[must_use]
    pub fn keep(mut self) -> Pending<R, A> {
        self.token()
    }

    fn token(&mut self) -> Pending<R, A> {
        self.token.take().expect("a query is used up once, by a method that consumes it")
    }
}

impl<R: CommObject, A: CommObject> Deref for Query<'_, R, A> {
    type Target = R;
    fn deref(&self) -> &R {
        self.request
    }
}

/// A query that is answered later, from any callback of the component. One that is dropped unanswered ends with
/// `Status::Error` at the client.
pub struct Pending<R: CommObject, A: CommObject> {
    /// Nothing once it is over.
    call: Option<CallRef>,
    objects: PhantomData<fn(R) -> A>,
}

impl<R: CommObject, A: CommObject> Pending<R, A> {
    /// The request.
    ///
    /// # Errors
    /// `WrongId` (the call was ended meanwhile), `NotAllowed`, `Closed`.
    pub fn request(&self) -> Result<&R, Status> {
        let call = self.call.ok_or(Status::WrongId)?;
        let lent = (api().opened)(call.port, call.id);
        Status::check(lent.status)?;
        calls::request_of(lent.value).ok_or(Status::Error)
    }

    /// Answers.
    ///
    /// # Errors
    /// As [`Query::answer`].
    pub fn answer(self, answer: A) -> Result<(), Status> {
        let mut loan = self.lend()?;
        *loan = answer;
        loan.send()
    }

    /// Lends the answer to be filled in place and sent, in this callback.
    ///
    /// # Errors
    /// As [`Query::answer`].
    pub fn loan<'a>(self, _cx: &'a Context<'_>) -> Result<Answer<'a, A>, Status> {
        self.lend()
    }

    fn lend<'a>(mut self) -> Result<Answer<'a, A>, Status> {
        let call = self.call.take().ok_or(Status::WrongId)?;
        let lent = (api().answer_loan)(call.port, call.id);
        CallLoan::new(call.port, &lent).map(|loan| Answer { loan: Some(loan), callback: PhantomData })
    }

    /// Answers with a status, which the client gets instead of an answer.
    ///
    /// # Errors
    /// As [`Query::answer`].
    pub fn refuse(mut self, status: Status) -> Result<(), Status> {
        let call = self.call.take().ok_or(Status::WrongId)?;
        Status::check((api().refuse)(call.port, call.id, status.code()))
    }
}

impl<R: CommObject, A: CommObject> Drop for Pending<R, A> {
    fn drop(&mut self) {
        if let Some(call) = self.call {
            (api().refuse)(call.port, call.id, Status::Error.code());
        }
    }
}

/// An answer on loan. One that is dropped ends the query with `Status::Error` at the client.
///
/// It ends with the callback: if this component fails afterwards, the block is its client's again.
pub struct Answer<'a, A: CommObject> {
    /// Nothing once it was sent.
    loan: Option<CallLoan<A>>,
    callback: PhantomData<&'a ()>,
}

impl<A: CommObject> Answer<'_, A> {
    /// Sends it.
    ///
    /// # Errors
    /// As [`Query::answer`].
    pub fn send(mut self) -> Result<(), Status> {
        let loan = self.loan.take().ok_or(Status::WrongId)?;
        Status::check((api().answer)(loan.call.port, loan.call.id))
    }
}

impl<A: CommObject> Deref for Answer<'_, A> {
    type Target = A;
    fn deref(&self) -> &A {
        self.loan.as_ref().expect("only `send` takes it").get()
    }
}

impl<A: CommObject> DerefMut for Answer<'_, A> {
    fn deref_mut(&mut self) -> &mut A {
        self.loan.as_mut().expect("only `send` takes it").get_mut()
    }
}

impl<A: CommObject> Drop for Answer<'_, A> {
    fn drop(&mut self) {
        if let Some(loan) = &self.loan {
            (api().refuse)(loan.call.port, loan.call.id, Status::Error.code());
        }
    }
}
