//! The client's end of a push: its subscription, its waits, and what waits for its handler. The values themselves lie in its
//! input.
//!
//! A wait for the next value has no memory: it remembers how many had arrived when it began (`news`). Whatever else
//! ends it, an end of the connection, of the subscription or of the server, is told by its code and counted.

use std::sync::atomic::{AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use component_sdk::abi::calls::{ServeArgs, ServeKind, Wait, Whose};
use component_sdk::abi::payload::PortHandle;
use component_sdk::abi::push::PushInfo;
use component_sdk::status::Status;
use crossbeam_queue::ArrayQueue;

use super::news::News;
use super::outlet::Outlet;
use crate::port::block::{Newest, Sample};
use crate::port::exchange::Exchange;
use crate::port::gate::{Gate, patience_ns};
use crate::port::wait::{Place, Waiter};
use crate::sys::bell::{Ring, Signal};

/// Which values of its writers a reader gets. Counted by calls, for all of its writers together.
#[derive(Debug)]
pub struct Turn {
    /// Every n-th; 0: none.
    every: AtomicU32,
    /// So many are passed over before the next.
    left: AtomicU32,
}

impl Turn {
    /// Every n-th, the next one first.
    #[must_use]
    pub const fn new(every: u32) -> Self {
        Self { every: AtomicU32::new(every), left: AtomicU32::new(0) }
    }

    /// Every n-th; 0: none.
    #[must_use]
    pub fn every(&self) -> u32 {
        self.every.load(Ordering::SeqCst)
    }

    /// Counts anew: the next one is the first.
    pub fn reset(&self) {
        self.left.store(0, Ordering::SeqCst);
    }

    fn begin(&self, every: u32) {
        self.reset();
        self.every.store(every, Ordering::SeqCst);
    }

    fn end(&self) {
        self.every.store(0, Ordering::SeqCst);
    }

    /// Counts one; true: it is one of the n-th. `None`: none is wanted.
    pub fn takes(&self) -> Option<bool> {
        let every = match self.every.load(Ordering::Acquire) {
            0 => return None,
            1 => return Some(true),
            every => every,
        };
        let count = |left: u32| Some(if left == 0 { every - 1 } else { left - 1 });
        let before = self.left.fetch_update(Ordering::AcqRel, Ordering::Relaxed, count);
        Some(before == Ok(0))
    }
}

/// Arrivals that enter a handler.
struct Handled {
    turn: Turn,
    queue: ArrayQueue<Sample>,
    /// Values that made room for others.
    lost: AtomicU64,
    /// The one that the handler looks at.
    current: Newest,
}

/// What profile and class say of a client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terms {
    /// The profile's prescale, which holds whatever the client asks for.
    pub prescale: Option<u32>,
    /// Time that a wait takes at most, in nanoseconds, where the author says nothing.
    pub timeout_ns: u64,
    /// Every n-th arrival enters a handler, and so many may wait for it.
    pub handler: Option<(u32, usize)>,
}

/// The client's end of a push.
pub struct Subscriber {
    terms: Terms,
    turn: Turn,
    gate: Gate,
    waiter: Arc<Waiter>,
    /// Who sends to it; most often one.
    servers: Exchange<Vec<Arc<Outlet>>>,
    news: News,
    /// Counts what its values belong to: those of an earlier one are not shown.
    session: AtomicU32,
    shown: AtomicU32,
    handled: Option<Handled>,
    handle: AtomicUsize,
    signal: OnceLock<Arc<Signal>>,
}

impl Subscriber {
    /// One without a server.
    #[must_use]
    pub fn new(terms: Terms, waiter: Arc<Waiter>) -> Self {
        let handled = |(every, room): (u32, usize)| Handled {
            turn: Turn::new(every.max(1)),
            queue: ArrayQueue::new(room.max(1)),
            lost: AtomicU64::new(0),
            current: Newest::default(),
        };
        Self {
            terms,
            turn: Turn::new(0),
            gate: Gate::default(),
            waiter,
            servers: Exchange::new(Vec::new()),
            news: News::default(),
            session: AtomicU32::new(0),
            shown: AtomicU32::new(0),
            handled: terms.handler.map(handled),
            handle: AtomicUsize::new(0),
            signal: OnceLock::new(),
        }
    }

    /// Says who is rung when a value arrives that somebody waits for; once.
    pub fn listen(&self, signal: Arc<Signal>) {
        let _ = self.signal.set(signal);
    }

    /// From now on the instance with this handle is the client.
    pub fn bind(&self, handle: PortHandle) {
        self.handle.store(handle.0.addr(), Ordering::Release);
    }

    fn ring(&self, why: Ring) {
        if let Some(signal) = self.signal.get() {
            signal.ring(why);
        }
    }

    /// How many blocks its handler's queue holds.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.handled.as_ref().map_or(0, |handled| handled.queue.capacity() + 1)
    }

    /// True where arrivals enter a handler.
    #[must_use]
    pub const fn has_handler(&self) -> bool {
        self.handled.is_some()
    }

    /// Which values it gets.
    #[must_use]
    pub const fn turn(&self) -> &Turn {
        &self.turn
    }

    /// Another one sends to it.
    pub(in crate::port) fn join(&self, server: &Arc<Outlet>) {
        let with = |now: &Vec<Arc<Outlet>>| {
            let others = now.iter().filter(|known| !Arc::ptr_eq(known, server));
            others.chain([server]).map(Arc::clone).collect()
        };
        // Whoever wires a reader has the right to, alone: nobody else is at it.
        let _ = self.servers.edit(with);
    }

    /// One sends to it no longer; true: nobody does.
    pub(in crate::port) fn part(&self, server: &Arc<Outlet>) -> bool {
        let without =
            |now: &Vec<Arc<Outlet>>| now.iter().filter(|known| !Arc::ptr_eq(known, server)).map(Arc::clone).collect();
        let _ = self.servers.edit(without);
        self.servers.visit(Vec::is_empty).unwrap_or_default()
    }

    /// Asks its server.
    ///
    /// # Errors
    /// `Disconnected`: there is none.
    fn ask<R>(&self, question: impl FnOnce(&[Arc<Outlet>]) -> R) -> Result<R, Status> {
        let answer = self.servers.visit(|servers| (!servers.is_empty()).then(|| question(servers)));
        answer.map_err(|_| Status::Error)?.ok_or(Status::Disconnected)
    }

    /// Wants every n-th value.
    ///
    /// # Errors
    /// `Error`: every 0-th; `Disconnected`.
    pub fn subscribe(&self, prescale: u32) -> Result<(), Status> {
        if prescale == 0 {
            return Err(Status::Error);
        }
        self.ask(|_| ())?;
        if self.turn.every() == 0 {
            self.handled.iter().for_each(|handled| handled.turn.reset());
            self.turn.begin(self.terms.prescale.unwrap_or(prescale));
        }
        Ok(())
    }

    /// Wants none any more; a wait ends with that status, and no other in between.
    pub(in crate::port) fn unsubscribe(&self, status: Status) {
        self.turn.end();
        self.forget();
        self.end_waits(status);
    }

    /// What has arrived is not shown any more.
    pub(in crate::port) fn forget(&self) {
        self.session.fetch_add(1, Ordering::SeqCst);
        self.handled.iter().for_each(|handled| while handled.queue.pop().is_some() {});
    }

    /// True where what the client looks at is of an earlier session; not so the next time. Its own thread only.
    pub(in crate::port) fn is_outdated(&self) -> bool {
        let session = self.session.load(Ordering::SeqCst);
        self.shown.swap(session, Ordering::Relaxed) != session
    }

    /// Ends a wait that has begun.
    pub(in crate::port) fn end_waits(&self, status: Status) {
        self.news.end(status);
        self.ring(Ring::Wait);
    }

    /// A value is about to be put into the input: its handler gets it, too, if it is its turn.
    pub(in crate::port) fn note(&self, sample: &Sample) {
        let Some(handled) = self.handled.as_ref().filter(|handled| handled.turn.takes() == Some(true)) else {
            return;
        };
        if handled.queue.force_push(Arc::clone(sample)).is_some() {
            handled.lost.fetch_add(1, Ordering::Relaxed);
        }
        self.ring(Ring::Serve);
    }

    /// Values that its handler never saw, because its queue was full.
    #[must_use]
    pub(in crate::port) fn lost(&self) -> u64 {
        self.handled.as_ref().map_or(0, |handled| handled.lost.load(Ordering::Relaxed))
    }

    /// A value is in the input.
    pub(in crate::port) fn arrived(&self) {
        if self.news.arrived() {
            self.ring(Ring::Wait);
        }
    }

    /// True when a value waits for the handler.
    #[must_use]
    pub fn waits(&self) -> bool {
        self.handled.as_ref().is_some_and(|handled| !handled.queue.is_empty())
    }

    /// What the handler is entered with; it stays until the next one. The slot's executor only.
    #[must_use]
    pub fn next(&self) -> Option<ServeArgs> {
        let handled = self.handled.as_ref()?;
        let sample = handled.queue.pop()?;
        let value: *const u8 = sample.value();
        drop(handled.current.put(sample));
        let port = PortHandle(std::ptr::without_provenance(self.handle.load(Ordering::Acquire)));
        Some(ServeArgs { port, what: ServeKind::Value, id: 0, value })
    }

    /// Whether there is a value to be had.
    ///
    /// # Errors
    /// `Disconnected`, `Unsubscribed`, `NotActivated`.
    pub(in crate::port) fn standing(&self) -> Result<(), Status> {
        let is_running = self.ask(|servers| servers.iter().any(|server| server.is_running()))?;
        match (self.turn.every(), is_running) {
            (0, _) => Err(Status::Unsubscribed),
            (_, false) => Err(Status::NotActivated),
            _ => Ok(()),
        }
    }

    /// Waits for the next value.
    ///
    /// # Errors
    /// Why none came.
    pub(in crate::port) fn wait(&self, wait: Wait, place: &impl Place) -> Result<(), Status> {
        let known = self.news.known();
        let closings = self.gate.closings();
        self.standing()?;
        // Only where all refuse there is nothing to wait for.
        let refusal = |servers: &[Arc<Outlet>]| {
            let has_one = servers.iter().any(|server| server.refusal().is_none());
            servers.first().filter(|_| !has_one).and_then(|server| server.refusal())
        };
        self.ask(refusal)?.map_or(Ok(()), Err)?;
        if !self.gate.lets_wait(closings) {
            return Err(Status::Cancelled);
        }
        let begins = |servers: &[Arc<Outlet>]| match servers {
            [server] => self.waiter.begin(&server.waiter),
            _ => true,
        };
        if !self.ask(begins)? {
            return Err(Status::Cycle);
        }
        let until_ns = place.now_ns().saturating_add(patience_ns(wait, self.terms.timeout_ns));
        let end = self.news.wait(known, &self.gate, closings, until_ns, place);
        self.waiter.end();
        end
    }

    /// Cycle and state of its server.
    ///
    /// # Errors
    /// `Disconnected`.
    pub fn info(&self) -> Result<PushInfo, Status> {
        self.ask(|servers| {
            let server = servers.iter().find(|server| server.cycle().period_ns.is_some()).or(servers.first());
            let period_ns = server.and_then(|server| server.cycle().period_ns).unwrap_or(0);
            PushInfo { period_ns, running: server.is_some_and(|server| server.is_running()), status: 0 }
        })
    }

    /// The author's gates.
    pub fn blocking(&self, whose: Whose, on: bool) {
        self.gate.set_author(whose, on);
        self.ring(Ring::Wait);
    }

    /// The gate of the slot: closed, waits end and begin no more.
    pub fn set_blocking(&self, on: bool) {
        self.gate.set_slot(on);
        self.ring(Ring::Wait);
    }

    /// The instance failed or left: it waits for nothing. The subscription is the slot's.
    pub fn change_hands(&self) {
        self.news.stop();
        self.waiter.end();
        self.gate.open_authors();
        if self.waits() {
            self.ring(Ring::Serve);
        }
    }
}
