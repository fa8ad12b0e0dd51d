//! The client's end of events: its activations, its connection, its waits.
//!
//! Every wait is a loop over conditions on the fiber that waits, as that of a query.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use component_sdk::abi::calls::{Lent, ServeArgs, ServeKind, Wait, Whose};
use component_sdk::abi::events::{Mode, Which};
use component_sdk::abi::payload::PortHandle;
use component_sdk::object::TypeDescriptor;
use component_sdk::status::Status;

use super::activation::{self, Activations};
use super::event_server::EventServer;
use crate::model::limits::{ACTIVATIONS_MAX, FIFO_SIZE_MAX};
use crate::port::block::Sample;
use crate::port::gate::{Gate, patience_ns};
use crate::port::wait::{Place, Waiter};
use crate::profile::plan::Overflow;
use crate::sys::bell::{Ring, Signal};

/// What of a client of events its profile and its class say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// Activations at once.
    pub activations: usize,
    /// Firings that may wait for the handler.
    pub queue: usize,
    /// What a full queue does with one more.
    pub overflow: Overflow,
    /// There is a handler.
    pub handled: bool,
    /// Time that a wait takes at most, in nanoseconds, where the author says nothing.
    pub timeout_ns: u64,
}

/// Where a client is connected.
#[derive(Default)]
struct Link {
    server: Option<Arc<EventServer>>,
    /// Every server that it was ever connected with: whoever is on its way into one is not to be its last holder.
    known: Vec<Arc<EventServer>>,
}

/// The client's end of a port.
pub struct EventClient {
    /// Name.
    pub name: String,
    /// What is asked for.
    pub parameter: &'static TypeDescriptor,
    /// What is told.
    pub event: &'static TypeDescriptor,
    pub(super) activations: Arc<Activations>,
    link: Mutex<Link>,
    /// Held while the connection is changed.
    wiring: Mutex<()>,
    gate: Gate,
    waiter: Arc<Waiter>,
    timeout_ns: u64,
    /// The handle of the instance in use.
    handle: AtomicUsize,
    /// What was fetched last.
    current: Mutex<Option<Sample>>,
    /// What the handler is entered for.
    serving: Mutex<Option<Sample>>,
    handled: AtomicU64,
}

fn hold<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Puts a sample in the place of another, which is dropped when nothing is held.
fn replace(place: &Mutex<Option<Sample>>, sample: Option<Sample>) {
    let before = std::mem::replace(&mut *hold(place), sample);
    drop(before);
}

impl EventClient {
    /// An unconnected one.
    #[must_use]
    pub fn new(
        name: &str,
        parameter: &'static TypeDescriptor,
        event: &'static TypeDescriptor,
        room: Room,
        waiter: Arc<Waiter>,
    ) -> Self {
        let Room { activations, queue, overflow, handled, timeout_ns } = room;
        let activations = activations.clamp(1, ACTIVATIONS_MAX);
        let room = activation::Room { activations, queue: queue.clamp(1, FIFO_SIZE_MAX), overflow, handled };
        Self {
            name: name.to_owned(),
            parameter,
            event,
            activations: Activations::new(parameter, room),
            link: Mutex::default(),
            wiring: Mutex::default(),
            gate: Gate::default(),
            waiter,
            timeout_ns,
            handle: AtomicUsize::new(0),
            current: Mutex::default(),
            serving: Mutex::default(),
            handled: AtomicU64::new(0),
        }
    }

    /// Says who is rung when an activation fires; once.
    pub fn listen(&self, signal: Arc<Signal>) {
        self.activations.listen(signal);
    }

    /// From now on the instance with this handle is told.
    pub fn bind(&self, handle: PortHandle) {
        self.handle.store(handle.0.addr(), Ordering::Release);
    }

    /// Activations, of at most how many, firings that wait for the handler, and firings that it was entered for.
    #[must_use]
    pub fn counts(&self) -> (usize, usize, usize, u64) {
        let activations = &self.activations;
        let handled = self.handled.load(Ordering::Relaxed);
        (activations.count(), activations.room().activations, activations.waiting(), handled)
    }

    fn server(&self) -> Option<Arc<EventServer>> {
        hold(&self.link).server.clone()
    }

    /// Where it leads, to be compared with a server's address; null: nowhere.
    #[must_use]
    pub fn peer(&self) -> *const EventServer {
        hold(&self.link).server.as_ref().map_or(std::ptr::null(), Arc::as_ptr)
    }

    /// True when it leads to this one.
    #[must_use]
    pub fn leads_to(&self, server: &Arc<EventServer>) -> bool {
        std::ptr::eq(self.peer(), Arc::as_ptr(server))
    }

    /// Leads to that server from now on. Activations at another one are over; at the same one they go on.
    ///
    /// # Errors
    /// How the objects differ; it is disconnected then, whatever it was before.
    pub fn connect(&self, server: &Arc<EventServer>) -> Result<(), String> {
        let _wiring = hold(&self.wiring);
        if self.leads_to(server) {
            return Ok(());
        }
        self.cut();
        if let Some(difference) = self.difference(server) {
            return Err(difference);
        }
        let mut link = hold(&self.link);
        if link.known.iter().all(|known| !Arc::ptr_eq(known, server)) {
            link.known.push(Arc::clone(server));
        }
        link.server = Some(Arc::clone(server));
        drop(link);
        server.add(&self.activations);
        self.activations.set_connected(true);
        Ok(())
    }

    /// Leads nowhere from now on. Its activations are over; whoever waits is told so.
    pub fn disconnect(&self) {
        let _wiring = hold(&self.wiring);
        self.cut();
    }

    fn cut(&self) {
        self.activations.set_connected(false);
        // Known besides: this is not its last holder.
        let server = hold(&self.link).server.take();
        if let Some(server) = server {
            server.remove(&self.activations);
        }
        self.activations.end_all(Status::Disconnected);
    }

    /// Where the objects of the two ends differ, in words.
    #[must_use]
    pub fn difference(&self, server: &EventServer) -> Option<String> {
        difference((self.parameter, self.event), (server.parameter, server.event))
    }

    /// The gate of the slot: closed, waits end and begin no more.
    pub fn set_blocking(&self, on: bool) {
        self.gate.set_slot(on);
        self.activations.ring(Ring::Wait);
    }

    /// The author's gates.
    pub fn blocking(&self, whose: Whose, on: bool) {
        self.gate.set_author(whose, on);
        self.activations.ring(Ring::Wait);
    }

    /// The instance failed or left: its activations are over and its numbers stale.
    pub fn forget(&self) {
        self.activations.forget();
        self.waiter.end();
        self.gate.open_authors();
        replace(&self.current, None);
        self.served();
    }

    /// Lends an activation and the block for its parameter.
    pub fn loan(&self) -> Lent {
        if let Some(status) = self.server().and_then(|server| server.refusal()) {
            return Lent::refused(status);
        }
        self.activations.claim().map_or_else(Lent::refused, |(id, parameter)| {
            let initialised = parameter.is_filled();
            // A block on loan counts as empty: what a trap leaves in it is half an object.
            parameter.forget_contents();
            Lent { value: parameter.value(), id, status: 0, initialised }
        })
    }

    /// Makes the activation on loan one.
    ///
    /// # Errors
    /// `WrongId`, `Disconnected`; it is over then.
    pub fn activate(&self, id: u64, mode: Mode) -> Result<(), Status> {
        self.activations.activate(id, mode)?;
        if let Some(server) = self.server() {
            server.announce(&self.activations, id);
        }
        Ok(())
    }

    /// Ends an activation.
    ///
    /// # Errors
    /// `WrongId`.
    pub fn deactivate(&self, id: u64) -> Result<(), Status> {
        self.activations.end(id, Status::NotActivated)
    }

    /// How far an activation is; success: an event can be fetched.
    ///
    /// # Errors
    /// `Active`, `Passive`, `WrongId`.
    pub fn state(&self, id: u64) -> Result<(), Status> {
        self.activations.state(id)
    }

    /// Fetches an event, waits for it if asked to.
    pub fn fetch(&self, id: u64, which: Which, wait: Wait, place: &impl Place) -> Lent {
        let fetched = self.activations.firings(id).and_then(|before| {
            // Whoever waits says so when it looks: an event that comes in between rings.
            let look = |waits| self.activations.take(id, which, before, waits);
            self.await_event(look, wait, place)
        });
        fetched.map_or_else(Lent::refused, |event| {
            let lent = Lent { value: event.value(), id, status: 0, initialised: true };
            replace(&self.current, Some(event));
            lent
        })
    }

    fn await_event(
        &self,
        look: impl Fn(bool) -> Result<Option<Sample>, Status>,
        wait: Wait,
        place: &impl Place,
    ) -> Result<Sample, Status> {
        if wait == Wait::NONE {
            return look(false)?.ok_or(Status::NoData);
        }
        let closings = self.gate.closings();
        let ended = || self.ended(&look).transpose();
        if let Some(end) = ended() {
            return end;
        }
        if !self.gate.lets_wait(closings) {
            return Err(Status::Cancelled);
        }
        let until_ns = place.now_ns().saturating_add(patience_ns(wait, self.timeout_ns));
        if self.server().is_some_and(|server| !self.waiter.begin(&server.waiter)) {
            return Err(Status::Cycle);
        }
        let end = self.gate.wait(closings, until_ns, place, ended);
        self.waiter.end();
        end
    }

    /// The event that is there, or why none will come.
    fn ended(&self, look: impl Fn(bool) -> Result<Option<Sample>, Status>) -> Result<Option<Sample>, Status> {
        if let Some(event) = look(true)? {
            return Ok(Some(event));
        }
        self.server().ok_or(Status::Disconnected)?.refusal().map_or(Ok(None), Err)
    }

    /// True when a firing waits for the handler.
    #[must_use]
    pub fn waits(&self) -> bool {
        self.activations.waiting() > 0
    }

    /// The next firing for the handler.
    pub fn next(&self) -> Option<ServeArgs> {
        let firing = self.activations.next_firing()?;
        let port = PortHandle(std::ptr::without_provenance(self.handle.load(Ordering::Acquire)));
        let args = ServeArgs { port, what: ServeKind::Firing, id: firing.id, value: firing.event.value() };
        replace(&self.serving, Some(firing.event));
        self.handled.fetch_add(1, Ordering::Relaxed);
        Some(args)
    }

    /// The handler is done.
    pub fn served(&self) {
        replace(&self.serving, None);
    }
}

impl Drop for EventClient {
    /// A server must not be left with activations that nobody hears of.
    fn drop(&mut self) {
        self.disconnect();
    }
}

/// Where parameter and event of two ends differ, in words.
#[must_use]
pub fn difference(
    client: (&'static TypeDescriptor, &'static TypeDescriptor),
    server: (&'static TypeDescriptor, &'static TypeDescriptor),
) -> Option<String> {
    let parts = [("parameter", client.0, server.0), ("event", client.1, server.1)];
    parts.into_iter().find_map(|(part, asked, served)| {
        let difference = asked.difference(served)?;
        Some(format!(
            "the {part} is {} at the client and {} at the server, and their layouts differ: {difference}",
            asked.name, served.name
        ))
    })
}
