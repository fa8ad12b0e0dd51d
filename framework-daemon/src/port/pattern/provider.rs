//! The server's end of queries and messages: a bounded inbox that any client fills, and the calls that its instance has in hand.
//!
//! All but `admit` and `replace` belongs to the thread of the slot's executor.

use std::sync::{Arc, OnceLock, PoisonError};

use component_sdk::abi::calls::{Lent, ServeArgs, ServeKind};
use component_sdk::abi::payload::PortHandle;
use component_sdk::status::Status;

use super::call::{Client, Ticket};
use super::direct::{Direct, Lane, Served};
use super::objects::Objects;
use super::turns::Turns;
use crate::model::limits::INBOX_MAX;
use crate::port::gate::Gate;
use crate::port::wait::Waiter;
use crate::sys::bell::{Ring, Signal};
use crate::sys::shared::{
    ArrayQueue, AtomicBool, AtomicU8, AtomicU32, AtomicU64, AtomicUsize, Mutex, MutexGuard, Ordering,
};

/// Whether a provider answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Openness {
    /// Not yet: calls wait.
    Starting,
    /// Now.
    Serving,
    /// Its slot was stopped.
    Stopped,
    /// Its slot failed for good.
    Gone,
    /// Its slot was removed or built anew; stays so.
    Replaced,
}

impl Openness {
    const ALL: [Self; 5] = [Self::Starting, Self::Serving, Self::Stopped, Self::Gone, Self::Replaced];

    /// The one of that number.
    pub(super) fn of(number: u8) -> Self {
        Self::ALL[usize::from(number) % Self::ALL.len()]
    }

    /// What a call gets that is not waited with any more.
    pub(super) const fn refusal(self) -> Option<Status> {
        match self {
            Self::Starting | Self::Serving => None,
            Self::Stopped => Some(Status::ProviderStopped),
            Self::Gone => Some(Status::ProviderGone),
            Self::Replaced => Some(Status::ProviderReplaced),
        }
    }
}

/// A call in the hand of the instance.
#[derive(Default)]
struct Held {
    /// The server's number of it; 0: nothing here.
    id: AtomicU64,
    /// The block for its answer is on loan.
    is_lent: AtomicBool,
    /// To be served by the successor of the instance that had it.
    again: AtomicBool,
    // Held for a few instructions in which no memory of a plugin is touched.
    ticket: Mutex<Option<Ticket>>,
}

impl Held {
    fn ticket(&self) -> MutexGuard<'_, Option<Ticket>> {
        self.ticket.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, id: u64, ticket: Ticket) {
        self.is_lent.store(false, Ordering::Relaxed);
        self.again.store(false, Ordering::Relaxed);
        *self.ticket() = Some(ticket);
        self.id.store(id, Ordering::Release);
    }

    /// Out of the hand. The place is free last: another thread may be looking for one.
    fn take(&self) -> Option<Ticket> {
        let ticket = self.ticket().take();
        self.id.store(0, Ordering::Release);
        ticket
    }
}

/// The server's end of a port.
pub struct Provider {
    /// Name.
    pub name: String,
    /// What is asked and answered, or sent.
    pub objects: Objects,
    /// The component has a handler; one without takes its calls by itself.
    has_handler: bool,
    /// Whether it may wait for them.
    pub(super) gate: Gate,
    pub(super) waiter: Arc<Waiter>,
    inbox: ArrayQueue<Ticket>,
    held: Box<[Held]>,
    /// Where the next free place is looked for.
    cursor: AtomicUsize,
    /// Calls in hand, and how many of them wait for a successor.
    in_hand: AtomicU32,
    again: AtomicU32,
    numbers: AtomicU32,
    open: AtomicU8,
    /// The handle of the instance in use.
    handle: AtomicUsize,
    signal: OnceLock<Arc<Signal>>,
    /// Where its slot has others: the order in which they are asked, and its place in their list.
    turns: OnceLock<(Arc<Turns>, usize)>,
    refused: AtomicU64,
    direct: Direct,
}

impl Provider {
    /// One that is not open yet, with room for that many calls that wait and as many in hand.
    #[must_use]
    pub fn new(name: &str, objects: Objects, room: usize, waiter: Arc<Waiter>) -> Self {
        let room = room.clamp(1, INBOX_MAX);
        Self {
            name: name.to_owned(),
            objects,
            has_handler: true,
            gate: Gate::default(),
            waiter,
            inbox: ArrayQueue::new(room),
            held: (0..room).map(|_| Held::default()).collect(),
            cursor: AtomicUsize::new(0),
            in_hand: AtomicU32::new(0),
            again: AtomicU32::new(0),
            numbers: AtomicU32::new(0),
            open: AtomicU8::new(Openness::Starting as u8),
            handle: AtomicUsize::new(0),
            signal: OnceLock::new(),
            turns: OnceLock::new(),
            refused: AtomicU64::new(0),
            direct: Direct::default(),
        }
    }

    /// The same, for a component that takes its calls by itself.
    #[must_use]
    pub fn without_handler(mut self) -> Self {
        self.has_handler = false;
        self
    }

    /// Number of calls that may wait.
    pub(super) fn room(&self) -> usize {
        self.held.len()
    }

    pub(super) fn take_turns(&self, turns: Arc<Turns>, place: usize) {
        let _ = self.turns.set((turns, place));
    }

    pub(super) fn turns(&self) -> Option<&Turns> {
        self.turns.get().map(|(turns, _)| turns.as_ref())
    }

    pub(super) const fn has_handler(&self) -> bool {
        self.has_handler
    }

    /// Says who is rung when a call comes in; once.
    pub fn listen(&self, signal: Arc<Signal>) {
        let _ = self.signal.set(signal);
    }

    /// Says how its handler is entered from where a client asks; once.
    pub fn use_lane(&self, lane: Arc<dyn Lane>) {
        if self.has_handler {
            self.direct.use_lane(lane);
        }
    }

    /// From now on the instance with this handle answers.
    pub fn bind(&self, handle: PortHandle) {
        self.handle.store(handle.0.addr(), Ordering::Release);
    }

    /// Calls that wait, calls in hand, and calls that found the inbox full.
    #[must_use]
    pub fn counts(&self) -> (usize, u32, u64) {
        (self.inbox.len(), self.in_hand.load(Ordering::Relaxed), self.refused.load(Ordering::Relaxed))
    }

    fn openness(&self) -> Openness {
        Openness::of(self.open.load(Ordering::SeqCst))
    }

    /// The status with which it refuses calls, if it does.
    pub(super) fn refusal(&self) -> Option<Status> {
        self.openness().refusal()
    }

    /// Takes a call in; any thread.
    ///
    /// # Errors
    /// `Overload`: the inbox is full; the ticket is gone, its call untouched.
    pub(super) fn admit(&self, ticket: Ticket) -> Result<(), Status> {
        if self.inbox.push(ticket).is_err() {
            self.refused.fetch_add(1, Ordering::Relaxed);
            return Err(Status::Overload);
        }
        if let Some((turns, place)) = self.turns.get() {
            turns.came(*place);
        }
        self.ring();
        // It may have been closed since the client looked; what came in after that has nobody else to end it.
        if self.refusal().is_some() {
            self.clear_inbox();
        }
        Ok(())
    }

    /// Whatever of its slot waits looks at its conditions again.
    pub fn wake(&self) {
        self.signal.get().into_iter().for_each(|signal| signal.ring(Ring::Wait));
    }

    pub(super) fn ring(&self) {
        if let Some(signal) = self.signal.get() {
            signal.ring(if self.has_handler { Ring::Serve } else { Ring::Wait });
        }
    }

    /// True when a call waits for a handler that can be entered.
    #[must_use]
    pub fn waits(&self) -> bool {
        self.has_handler && self.has_calls()
    }

    /// True where the next call can be answered from where it is asked: none is before it.
    #[inline]
    pub(super) fn is_open_at_once(&self) -> bool {
        let is_idle = |lane: &&dyn Lane| {
            self.openness() == Openness::Serving
                && self.inbox.is_empty()
                && self.again.load(Ordering::Relaxed) == 0
                && self.has_room()
                && lane.is_open()
        };
        self.direct.lane().filter(is_idle).is_some()
    }

    /// Enters the handler for a call from where it is asked. One that is not answered then is in hand.
    pub(super) fn serve_at_once(&self, client: &Arc<Client>, index: u32, generation: u32) -> Served {
        let (Some(lane), Some(place)) = (self.direct.lane(), self.free_place()) else { return Served::Not };
        let call = &client.calls()[index as usize];
        call.take(generation);
        let id = self.number(place);
        let args = self.args(id, call.request.value());
        let (served, is_open) = self.direct.hold(id, client, call, || lane.serve(args));
        if is_open && served != Served::Not {
            let held = &self.held[place];
            held.put(id, Ticket::new(client, index, generation));
            held.is_lent.store(self.direct.is_lent(), Ordering::Relaxed);
            self.in_hand.fetch_add(1, Ordering::Relaxed);
        }
        served
    }

    fn has_calls(&self) -> bool {
        self.again.load(Ordering::Relaxed) > 0 || (!self.inbox.is_empty() && self.has_room())
    }

    pub(super) fn has_room(&self) -> bool {
        (self.in_hand.load(Ordering::Relaxed) as usize) < self.held.len()
    }

    /// The next call to be served by a handler, in hand from now on; `None`: nothing waits, or the hands are full.
    pub fn next(&self) -> Option<ServeArgs> {
        if self.has_handler { self.take() } else { None }
    }

    /// The next call, in hand from now on.
    pub(super) fn take(&self) -> Option<ServeArgs> {
        if self.again.load(Ordering::Relaxed) > 0
            && let Some(args) = self.next_again()
        {
            return Some(args);
        }
        while self.has_room() {
            let ticket = self.inbox.pop()?;
            if !ticket.is_wanted() {
                ticket.end(Status::Disconnected.code());
                continue;
            }
            let index = self.free_place()?;
            ticket.take();
            let request = ticket.call().request.value();
            let id = self.number(index);
            self.held[index].put(id, ticket);
            self.in_hand.fetch_add(1, Ordering::Relaxed);
            return Some(self.args(id, request));
        }
        None
    }

    /// A call whose server failed.
    fn next_again(&self) -> Option<ServeArgs> {
        loop {
            let index = self.held.iter().position(|held| held.again.swap(false, Ordering::Relaxed))?;
            self.again.fetch_sub(1, Ordering::Relaxed);
            let held = &self.held[index];
            let wanted =
                held.ticket().as_ref().filter(|ticket| ticket.is_wanted()).map(|ticket| ticket.call().request.value());
            let Some(request) = wanted else {
                self.let_go(held, Status::Disconnected);
                continue;
            };
            let id = self.number(index);
            held.id.store(id, Ordering::Release);
            return Some(self.args(id, request));
        }
    }

    fn args(&self, id: u64, request: *const u8) -> ServeArgs {
        let port = PortHandle(std::ptr::without_provenance(self.handle.load(Ordering::Acquire)));
        let what = if self.objects.is_one_way() { ServeKind::Message } else { ServeKind::Request };
        ServeArgs { port, what, id, value: request }
    }

    fn free_place(&self) -> Option<usize> {
        let from = self.cursor.load(Ordering::Relaxed);
        let order = (from..self.held.len()).chain(0..from);
        // A place whose number is 0 but whose ticket waits for a successor is not free.
        let index = order.into_iter().find(|index| {
            let held = &self.held[*index];
            held.id.load(Ordering::Relaxed) == 0 && !held.again.load(Ordering::Relaxed)
        })?;
        self.cursor.store(index, Ordering::Relaxed);
        Some(index)
    }

    /// A number that no call in hand has had: place and count.
    fn number(&self, index: usize) -> u64 {
        let count = self.numbers.load(Ordering::Relaxed).wrapping_add(1).max(1);
        self.numbers.store(count, Ordering::Relaxed);
        u64::from(count) << 32 | index as u64
    }

    fn held(&self, id: u64) -> Result<&Held, Status> {
        let held = self.held.get(id as u32 as usize).filter(|_| id != 0).ok_or(Status::WrongId)?;
        if held.id.load(Ordering::Acquire) == id { Ok(held) } else { Err(Status::WrongId) }
    }

    /// The request of a call in hand.
    pub fn opened(&self, id: u64) -> Lent {
        if let Some(value) = self.direct.opened(id) {
            return Lent { value, id, status: 0, initialised: true };
        }
        self.lend(id, |held, ticket| {
            let _ = held;
            (ticket.call().request.value(), true)
        })
    }

    /// Lends the block for the answer of a call in hand.
    pub fn answer_loan(&self, id: u64) -> Lent {
        if let Some((value, initialised)) = self.direct.answer_loan(id) {
            return Lent { value, id, status: 0, initialised };
        }
        self.lend(id, |held, ticket| {
            let block = &ticket.call().answer;
            // A block on loan counts as empty: what a trap leaves in it is half an object.
            let is_filled = held.is_lent.swap(true, Ordering::Relaxed) || block.is_filled();
            block.forget_contents();
            (block.value(), is_filled)
        })
    }

    fn lend(&self, id: u64, what: impl FnOnce(&Held, &Ticket) -> (*mut u8, bool)) -> Lent {
        let lent = self.held(id).and_then(|held| {
            let ticket = held.ticket();
            let (value, initialised) = what(held, ticket.as_ref().ok_or(Status::WrongId)?);
            Ok(Lent { value, id, status: 0, initialised })
        });
        lent.unwrap_or_else(Lent::refused)
    }

    /// Sends the answer on loan.
    ///
    /// # Errors
    /// `WrongId`; `NotAllowed`: nothing is on loan; `Disconnected`: the client has left.
    pub fn answer(&self, id: u64) -> Result<(), Status> {
        if let Some(finished) = self.direct.finish(id, 0) {
            return finished;
        }
        let held = self.held(id)?;
        if !held.is_lent.load(Ordering::Relaxed) {
            return Err(Status::NotAllowed);
        }
        self.finish(held, 0)
    }

    /// Lets a call go unanswered.
    ///
    /// # Errors
    /// `WrongId`; `Disconnected`: the client has left.
    pub fn refuse(&self, id: u64, status: Status) -> Result<(), Status> {
        if let Some(finished) = self.direct.finish(id, status.code()) {
            return finished;
        }
        let held = self.held(id)?;
        self.finish(held, status.code())
    }

    fn finish(&self, held: &Held, code: u32) -> Result<(), Status> {
        let was_full = !self.has_room();
        let is_lent = held.is_lent.load(Ordering::Relaxed);
        let ticket = held.take().ok_or(Status::WrongId)?;
        self.in_hand.fetch_sub(1, Ordering::Relaxed);
        if is_lent {
            ticket.call().answer.fill(0);
        }
        let is_left = ticket.is_left();
        ticket.end(if is_left { Status::Disconnected.code() } else { code });
        if was_full && !self.inbox.is_empty() {
            self.ring();
        }
        if is_left { Err(Status::Disconnected) } else { Ok(()) }
    }

    /// Whether it answers from now on. Whoever waits for one that does not is told so. Not while a handler is entered or
    /// waits: it would lose its request under its hands.
    pub fn set_open(&self, open: Openness) {
        let stays = |before: u8| (before != Openness::Replaced as u8).then_some(open as u8);
        if self.open.fetch_update(Ordering::SeqCst, Ordering::SeqCst, stays).is_err() {
            return self.let_all_go(Status::ProviderReplaced);
        }
        match open.refusal() {
            Some(status) => self.let_all_go(status),
            None if self.has_calls() => self.ring(),
            None => {}
        }
    }

    /// Its slot is about to be removed or built anew: nobody is to wait for it any more. What is in hand stays there
    /// until the slot has stopped. Any thread.
    pub fn replace(&self) {
        // An exchange, so that whoever opens it at the same moment comes before or sees it.
        self.open.swap(Openness::Replaced as u8, Ordering::SeqCst);
        self.clear_inbox();
    }

    /// The instance failed: what it had in hand is over, or waits for its successor where the connection says so.
    pub fn fail(&self) {
        for held in &self.held {
            if held.again.load(Ordering::Relaxed) || held.id.swap(0, Ordering::AcqRel) == 0 {
                continue;
            }
            let is_asked_again = held.ticket().as_ref().is_some_and(Ticket::is_asked_again);
            held.is_lent.store(false, Ordering::Relaxed);
            if is_asked_again {
                held.again.store(true, Ordering::Relaxed);
                self.again.fetch_add(1, Ordering::Relaxed);
            } else {
                self.let_go(held, Status::ProviderGone);
            }
        }
        if self.has_calls() {
            self.ring();
        }
    }

    fn let_all_go(&self, status: Status) {
        for held in &self.held {
            if held.again.swap(false, Ordering::Relaxed) {
                self.again.fetch_sub(1, Ordering::Relaxed);
            }
            self.let_go(held, status);
        }
        self.clear_inbox();
    }

    fn let_go(&self, held: &Held, status: Status) {
        if let Some(ticket) = held.take() {
            self.in_hand.fetch_sub(1, Ordering::Relaxed);
            ticket.end(status.code());
        }
    }

    /// Ends what waits in a provider that refuses; any thread: whoever takes a ticket out is its only holder.
    pub(super) fn clear_inbox(&self) {
        while let Some(status) = self.refusal()
            && let Some(ticket) = self.inbox.pop()
        {
            ticket.end(status.code());
        }
    }
}

impl Drop for Provider {
    fn drop(&mut self) {
        self.replace();
        self.let_all_go(Status::ProviderReplaced);
    }
}
