//! The client's end of queries and messages: its calls, its connection, its waits.
//!
//! Every wait is a loop over conditions on the fiber that asked. The executor knows none of them: it resumes a fiber
//! that was rung for or whose time is over.
#![allow(unsafe_code, reason = "address of unsafe: the provider that a connection leads to, by its address")]

use std::sync::{Arc, PoisonError};

use component_sdk::abi::calls::{Lent, Wait, Whose};
use component_sdk::status::Status;

use super::call::{Call, Client, ClientState, Look, Ticket};
use super::direct::Served;
use super::objects::Objects;
use super::provider::Provider;
use crate::model::limits::PENDING_MAX;
use crate::port::gate::{Gate, patience_ns};
use crate::port::wait::{Place, Waiter};
use crate::sys::bell::Signal;
use crate::sys::shared::{AtomicBool, AtomicPtr, AtomicU32, AtomicU64, AtomicUsize, Mutex, Ordering};

/// The client's end of a port.
pub struct Requestor {
    /// Name.
    pub name: String,
    /// What is asked and answered, or sent.
    pub objects: Objects,
    client: Arc<Client>,
    /// Where calls go; null: nowhere.
    link: AtomicPtr<Provider>,
    /// Every provider that `link` ever led to: a callback may be on its way into one.
    known: Mutex<Vec<Arc<Provider>>>,
    retry: AtomicBool,
    gate: Gate,
    waiter: Arc<Waiter>,
    room: Room,
    /// Where the next free call is looked for.
    cursor: AtomicUsize,
    asked: AtomicU64,
    failed: AtomicU32,
}

/// What of a port its profile says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// Calls that may be open at once.
    pub pending: usize,
    /// Time that a wait takes at most, in nanoseconds, where the author says nothing.
    pub timeout_ns: u64,
    /// A provider's successor is asked again, where the connection says nothing.
    pub retry: bool,
}

impl Requestor {
    /// An unconnected one.
    #[must_use]
    pub fn new(name: &str, objects: Objects, room: Room, waiter: Arc<Waiter>) -> Self {
        Self {
            name: name.to_owned(),
            objects,
            client: Client::new(objects, room.pending.clamp(1, PENDING_MAX)),
            link: AtomicPtr::new(std::ptr::null_mut()),
            known: Mutex::default(),
            retry: AtomicBool::new(false),
            gate: Gate::default(),
            waiter,
            room,
            cursor: AtomicUsize::new(0),
            asked: AtomicU64::new(0),
            failed: AtomicU32::new(0),
        }
    }

    /// Says who is rung when an answer is there; once.
    pub fn listen(&self, signal: Arc<Signal>) {
        self.client.listen(signal);
    }

    /// Calls sent, and calls that ended without an answer.
    #[must_use]
    pub fn counts(&self) -> (u64, u32) {
        (self.asked.load(Ordering::Relaxed), self.failed.load(Ordering::Relaxed))
    }

    fn provider(&self) -> Option<&Provider> {
        // SAFETY: `connect` stores addresses of what `known` holds, which is only dropped with `self`.
        unsafe { self.link.load(Ordering::Acquire).as_ref() }
    }

    /// Where it leads, to be compared with a provider's address; null: nowhere.
    #[must_use]
    pub fn peer(&self) -> *const Provider {
        self.link.load(Ordering::Acquire)
    }

    /// True when it leads to this one.
    #[must_use]
    pub fn leads_to(&self, provider: &Arc<Provider>) -> bool {
        std::ptr::eq(self.link.load(Ordering::Acquire), Arc::as_ptr(provider))
    }

    /// Leads to that provider from now on, and asks its successor again if `retry` says so, or the port where it does not. Open calls of another one are over; of the same one they go on.
    ///
    /// # Errors
    /// `IncompatibleService`, with both sides in words; it is disconnected then, whatever it was before.
    pub fn connect(&self, provider: &Arc<Provider>, retry: Option<bool>) -> Result<(), String> {
        let retry = retry.unwrap_or(self.room.retry);
        if self.leads_to(provider) {
            self.retry.store(retry, Ordering::Relaxed);
            return Ok(());
        }
        self.disconnect();
        if let Some(difference) = self.difference(provider) {
            return Err(difference);
        }
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if known.iter().all(|known| !Arc::ptr_eq(known, provider)) {
            known.push(Arc::clone(provider));
        }
        drop(known);
        self.retry.store(retry, Ordering::Relaxed);
        self.link.store(Arc::as_ptr(provider).cast_mut(), Ordering::Release);
        Ok(())
    }

    /// Leads nowhere from now on. Whoever waits is told so; answers that are there stay.
    pub fn disconnect(&self) {
        self.link.store(std::ptr::null_mut(), Ordering::SeqCst);
        self.client.next_epoch();
        self.client.ring();
    }

    /// Where the objects of the two ends differ, in words.
    #[must_use]
    pub fn difference(&self, provider: &Provider) -> Option<String> {
        self.objects.difference(&provider.objects)
    }

    /// The gate of the slot: closed, waits end and begin no more.
    pub fn set_blocking(&self, on: bool) {
        self.gate.set_slot(on);
        self.client.ring();
    }

    /// The author's gates.
    pub fn blocking(&self, whose: Whose, on: bool) {
        self.gate.set_author(whose, on);
        self.client.ring();
    }

    /// The instance failed or left: its calls are over and its numbers stale; servers find that it has left.
    pub fn close_calls(&self) {
        self.client.abandon();
        self.waiter.end();
        self.gate.open_authors();
    }

    /// Lends a call and the block for its request.
    pub fn loan(&self) -> Lent {
        let calls = self.client.calls();
        let from = self.cursor.load(Ordering::Relaxed);
        for index in (from..calls.len()).chain(0..from) {
            let call = &calls[index];
            let Some(generation) = call.begin() else { continue };
            self.cursor.store(index, Ordering::Relaxed);
            let initialised = call.request.is_filled();
            // A block on loan counts as empty: what a trap leaves in it is half an object.
            call.request.forget_contents();
            let id = u64::from(generation) << 32 | index as u64;
            return Lent { value: call.request.value(), id, status: 0, initialised };
        }
        Lent::refused(Status::Overload)
    }

    /// The call of that number, if the client is that far with it.
    fn call(&self, id: u64, state: ClientState) -> Result<(&Call, u32, u32), Status> {
        let (generation, index) = ((id >> 32) as u32, id as u32);
        let call = self.client.calls().get(index as usize).ok_or(Status::WrongId)?;
        if call.is_client(generation, state) { Ok((call, generation, index)) } else { Err(Status::WrongId) }
    }

    /// Sends the request on loan.
    ///
    /// # Errors
    /// `WrongId`, `Disconnected`, `Overload`, or what the provider refuses with; the call is over then.
    pub fn send(&self, id: u64) -> Result<(), Status> {
        let (call, generation, index) = self.call(id, ClientState::Loan)?;
        call.request.fill(0);
        let sent = self.hand_over(call, generation, index);
        match sent {
            Ok(()) => {
                self.asked.fetch_add(1, Ordering::Relaxed);
                if self.client.is_one_way() {
                    // The server's from now on.
                    call.set_client(generation, ClientState::Free);
                }
            }
            Err(_) => self.give_up(call, generation),
        }
        sent
    }

    fn hand_over(&self, call: &Call, generation: u32, index: u32) -> Result<(), Status> {
        // Before the link: a connection that changes in between makes the call one of the connection before.
        let epoch = self.client.epoch();
        let provider = self.provider().ok_or(Status::Disconnected)?;
        provider.refusal().map_or(Ok(()), Err)?;
        call.send(generation, epoch, self.retry.load(Ordering::Relaxed));
        let admitted = provider.admit(Ticket::new(&self.client, index, generation));
        if admitted.is_err() {
            call.unsend(generation);
        }
        admitted
    }

    fn give_up(&self, call: &Call, generation: u32) {
        self.failed.fetch_add(1, Ordering::Relaxed);
        call.set_client(generation, ClientState::Free);
    }

    /// Sends the request on loan and waits for the answer; whatever comes instead ends the call.
    pub fn ask(&self, id: u64, wait: Wait, place: &impl Place) -> Lent {
        // Before the handler may be entered from here: what closes the gate meanwhile ends the wait.
        let closings = self.gate.closings();
        match self.ask_at_once(id, wait, closings) {
            Served::Not => {
                if let Err(status) = self.send(id) {
                    return Lent::refused(status);
                }
            }
            Served::Done => {}
            // The executor sees to the server, then this goes on.
            Served::Aside => _ = place.park(place.now_ns()),
        }
        let lent = self.receive_since(closings, id, wait, place);
        if lent.status != 0
            && let Ok((call, generation, _)) = self.call(id, ClientState::Sent)
        {
            self.give_up(call, generation);
        }
        lent
    }

    /// Has the server's handler entered from here, where it is at rest and shares this executor.
    fn ask_at_once(&self, id: u64, wait: Wait, closings: u32) -> Served {
        let is_open =
            |provider: &&Provider| wait != Wait::NONE && provider.is_open_at_once() && self.gate.lets_wait(closings);
        let epoch = self.client.epoch();
        let Some(provider) = self.provider().filter(is_open) else { return Served::Not };
        let Ok((call, generation, index)) = self.call(id, ClientState::Loan) else { return Served::Not };
        call.request.fill(0);
        call.send(generation, epoch, self.retry.load(Ordering::Relaxed));
        self.waiter.note(&provider.waiter);
        let served = provider.serve_at_once(&self.client, index, generation);
        self.waiter.end();
        if served == Served::Not {
            call.take_back(generation);
        } else {
            // One callback, or one task, has the port: nobody else counts meanwhile.
            self.asked.store(self.asked.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        }
        served
    }

    /// Lends the answer, waits for it if asked to.
    pub fn receive(&self, id: u64, wait: Wait, place: &impl Place) -> Lent {
        self.receive_since(self.gate.closings(), id, wait, place)
    }

    /// The same for a wait that began when the gate had been closed that often.
    fn receive_since(&self, closings: u32, id: u64, wait: Wait, place: &impl Place) -> Lent {
        let (call, generation, _) = match self.call(id, ClientState::Sent) {
            Ok(call) => call,
            Err(status) => return Lent::refused(status),
        };
        match self.await_end(closings, (call, generation), wait, place) {
            Ok(Look::Answered) => {
                call.set_client(generation, ClientState::Lent);
                Lent { value: call.answer.value(), id, status: 0, initialised: true }
            }
            Ok(Look::Ended(status)) => {
                self.give_up(call, generation);
                Lent::refused(status)
            }
            Ok(Look::Open) => Lent::refused(Status::NoData),
            Err(status) => Lent::refused(status),
        }
    }

    /// How a call ended; an error: it has not, and is not waited for any longer.
    fn await_end(
        &self,
        closings: u32,
        (call, generation): (&Call, u32),
        wait: Wait,
        place: &impl Place,
    ) -> Result<Look, Status> {
        let look = self.look(call, generation);
        if look != Look::Open || wait == Wait::NONE {
            return Ok(look);
        }
        if !self.gate.lets_wait(closings) {
            return Err(Status::Cancelled);
        }
        let until_ns = place.in_ns(patience_ns(wait, self.room.timeout_ns));
        if self.provider().is_some_and(|provider| !self.waiter.begin(&provider.waiter)) {
            return Err(Status::Cycle);
        }
        let ended = || Some(self.look(call, generation)).filter(|look| *look != Look::Open).map(Ok);
        let end = self.gate.wait(closings, until_ns, place, ended);
        self.waiter.end();
        end
    }

    /// What is there is given out, whatever came after it.
    fn look(&self, call: &Call, generation: u32) -> Look {
        let look = call.look(generation);
        if look != Look::Open {
            return look;
        }
        if call.epoch() != self.client.epoch() {
            return Look::Ended(Status::Disconnected);
        }
        look
    }

    /// Gives an answer on loan back.
    pub fn release(&self, id: u64) {
        if let Ok((call, generation, _)) = self.call(id, ClientState::Lent) {
            call.set_client(generation, ClientState::Free);
        }
    }

    /// Gives a call up, sent or not.
    ///
    /// # Errors
    /// `WrongId`.
    pub fn discard(&self, id: u64) -> Result<(), Status> {
        if let Ok((call, generation, _)) = self.call(id, ClientState::Loan) {
            // Whole: its borrower gives it back.
            call.request.fill(0);
            call.set_client(generation, ClientState::Free);
            return Ok(());
        }
        let (call, generation, _) = self.call(id, ClientState::Sent)?;
        call.set_client(generation, ClientState::Free);
        Ok(())
    }
}

impl Drop for Requestor {
    /// Servers may still hold some of the calls: what they answer goes nowhere.
    fn drop(&mut self) {
        self.client.abandon();
    }
}
