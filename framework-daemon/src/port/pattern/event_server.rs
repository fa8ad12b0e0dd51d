//! The server's end of events: whose activations it tests, and the test that is going on.
//!
//! The test is a closure of the component and runs on the fiber that puts. Between two activations it comes back here, so
//! that nothing is locked while it runs; the one it has in hand stays where it is, even when its client leaves.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use component_sdk::abi::calls::{ServeArgs, ServeKind};
use component_sdk::abi::events::Testing;
use component_sdk::abi::payload::PortHandle;
use component_sdk::object::{Kind, TypeDescriptor};
use component_sdk::status::Status;

use super::activation::{Activations, Fired};
use super::provider::Openness;
use crate::model::limits::SPARE_BLOCKS;
use crate::port::check;
use crate::port::pool::{Lost, Pool};
use crate::port::wait::Waiter;
use crate::profile::plan::Overflow;
use crate::sys::bell::{Ring, Signal};
use crate::sys::clock;

/// A client, with a number that no other one of this server has had.
struct Known {
    number: u64,
    activations: Arc<Activations>,
}

/// An activation in the server's hands.
struct Spot {
    client: u64,
    activations: Arc<Activations>,
    index: usize,
    generation: u32,
}

impl Spot {
    fn let_go(self) {
        self.activations.let_go(self.index);
    }
}

/// A test that is going on.
struct Test {
    id: u64,
    spot: Spot,
    /// Address of the block for its event.
    event: usize,
}

/// The server's end of a port.
pub struct EventServer {
    /// Name.
    pub name: String,
    /// What is asked for.
    pub parameter: &'static TypeDescriptor,
    /// What is told.
    pub event: &'static TypeDescriptor,
    pub(super) waiter: Arc<Waiter>,
    /// In the order of their numbers.
    clients: Mutex<Vec<Known>>,
    numbers: AtomicU64,
    /// Used by whoever puts, one at a time.
    events: Pool,
    test: Mutex<Option<Test>>,
    /// What `on_activation` is entered for.
    told: Mutex<Option<Spot>>,
    /// The component wants to be told of activations, and there are some that it was not told of.
    hooked: bool,
    untold: AtomicBool,
    /// A client lost an event in this pass.
    lost: AtomicBool,
    open: AtomicU8,
    handle: AtomicUsize,
    signal: OnceLock<Arc<Signal>>,
    fired: AtomicU64,
    refused: AtomicU64,
}

fn hold<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// True of objects in which no bytes are wrong: half of one is another one.
fn is_plain(object: &TypeDescriptor) -> bool {
    match object.kind {
        Kind::Sequence | Kind::Text => false,
        _ => object.fields.iter().all(|field| is_plain(field.object)) && object.element().is_none_or(is_plain),
    }
}

impl EventServer {
    /// One that is not open yet. With `hooked` its component is told of each activation before it is tested first.
    #[must_use]
    pub fn new(
        name: &str,
        parameter: &'static TypeDescriptor,
        event: &'static TypeDescriptor,
        hooked: bool,
        waiter: Arc<Waiter>,
    ) -> Self {
        let events = Pool::new(event, Lost::Again);
        events.grow_to(SPARE_BLOCKS);
        Self {
            name: name.to_owned(),
            parameter,
            event,
            waiter,
            clients: Mutex::default(),
            numbers: AtomicU64::new(0),
            events,
            test: Mutex::default(),
            told: Mutex::default(),
            hooked,
            untold: AtomicBool::new(false),
            lost: AtomicBool::new(false),
            open: AtomicU8::new(Openness::Starting as u8),
            handle: AtomicUsize::new(0),
            signal: OnceLock::new(),
            fired: AtomicU64::new(0),
            refused: AtomicU64::new(0),
        }
    }

    /// Says who is rung when there is a new activation; once.
    pub fn listen(&self, signal: Arc<Signal>) {
        let _ = self.signal.set(signal);
    }

    /// From now on the instance with this handle puts.
    pub fn bind(&self, handle: PortHandle) {
        self.handle.store(handle.0.addr(), Ordering::Release);
    }

    /// Activations, events sent, and events that a client's queue lost.
    #[must_use]
    pub fn counts(&self) -> (usize, u64, u64) {
        let activations = hold(&self.clients).iter().map(|client| client.activations.count()).sum();
        (activations, self.fired.load(Ordering::Relaxed), self.refused.load(Ordering::Relaxed))
    }

    fn openness(&self) -> Openness {
        Openness::of(self.open.load(Ordering::SeqCst))
    }

    /// The status with which it refuses to be waited for, if it does.
    pub(super) fn refusal(&self) -> Option<Status> {
        self.openness().refusal()
    }

    /// A client is connected. Makes blocks for all that it can hold, so that no put allocates.
    pub(super) fn add(&self, activations: &Arc<Activations>) {
        let mut clients = hold(&self.clients);
        let number = self.numbers.fetch_add(1, Ordering::Relaxed) + 1;
        clients.push(Known { number, activations: Arc::clone(activations) });
        let wanted = clients.iter().map(|client| client.activations.capacity()).sum::<usize>() + SPARE_BLOCKS;
        drop(clients);
        self.events.grow_to(wanted);
    }

    /// A client left.
    pub(super) fn remove(&self, activations: &Arc<Activations>) {
        let mut clients = hold(&self.clients);
        let place = clients.iter().position(|client| Arc::ptr_eq(&client.activations, activations));
        let gone = place.map(|place| clients.remove(place));
        drop(clients);
        // Here, where nothing is held: the last holder of an object frees the memory of a plugin.
        drop(gone);
    }

    /// There is a new activation: tested from now on, or when the component was told.
    pub(super) fn announce(&self, activations: &Arc<Activations>, id: u64) {
        if self.hooked {
            self.untold.store(true, Ordering::Release);
            self.ring();
        } else {
            activations.know(id);
        }
    }

    fn ring(&self) {
        if let Some(signal) = self.signal.get() {
            signal.ring(Ring::Serve);
        }
    }

    /// The first activation to be tested.
    pub fn first(&self) -> Testing {
        self.leave();
        self.lost.store(false, Ordering::Relaxed);
        self.test_from(0, 0)
    }

    /// Says how a test ended; the next activation to be tested.
    pub fn next(&self, id: u64, fires: bool) -> Testing {
        let Some(Test { spot, event, .. }) = hold(&self.test).take_if(|test| test.id == id) else {
            return Testing::over(Status::WrongId);
        };
        // The block was lent by this pool, and is lent no more.
        if let Some(event) = self.events.end_loan(std::ptr::without_provenance_mut(event)) {
            event.fill(if fires { clock::now_ns() } else { 0 });
            if fires {
                match spot.activations.fire(spot.index, spot.generation, event) {
                    Fired::Kept => _ = self.fired.fetch_add(1, Ordering::Relaxed),
                    Fired::Lost => self.lose(spot.activations.room().overflow),
                    Fired::Unwanted => {}
                }
            }
        }
        let (client, index) = (spot.client, spot.index + 1);
        spot.let_go();
        self.test_from(client, index)
    }

    fn lose(&self, overflow: Overflow) {
        self.lost.store(true, Ordering::Relaxed);
        self.refused.fetch_add(1, Ordering::Relaxed);
        if overflow == Overflow::Fault {
            check::report_overload(&self.name);
        }
    }

    /// Gives a test up.
    pub fn leave_test(&self, id: u64) {
        if hold(&self.test).as_ref().is_some_and(|test| test.id == id) {
            self.leave();
        }
    }

    /// A test that was left by a panic: its parameter is whole.
    fn leave(&self) {
        let left = hold(&self.test).take();
        if let Some(test) = left {
            test.spot.let_go();
        }
    }

    fn test_from(&self, client: u64, index: usize) -> Testing {
        let Some(spot) = self.hold_next(client, index, true) else {
            let lost = self.lost.swap(false, Ordering::Relaxed);
            return Testing::over(if lost { Status::Overload } else { Status::NoData });
        };
        let lent = self.events.lend();
        let id = self.numbers.fetch_add(1, Ordering::Relaxed) + 1;
        let parameter = spot.activations.parameter(spot.index).value();
        *hold(&self.test) = Some(Test { id, spot, event: lent.value.addr() });
        Testing { parameter, event: lent.value, id, status: 0, initialised: lent.initialised }
    }

    /// The next activation in the order of clients and places, in hand from now on.
    fn hold_next(&self, client: u64, index: usize, announced: bool) -> Option<Spot> {
        let clients = hold(&self.clients);
        let from = clients.partition_point(|known| known.number < client);
        clients[from..].iter().find_map(|known| {
            let first = if known.number == client { index } else { 0 };
            let (index, generation) = known.activations.hold(first, announced)?;
            Some(Spot { client: known.number, activations: Arc::clone(&known.activations), index, generation })
        })
    }

    /// True when the component is to be told of an activation.
    #[must_use]
    pub fn waits(&self) -> bool {
        self.untold.load(Ordering::Acquire)
    }

    /// The next activation that the component is to be told of.
    pub fn next_told(&self) -> Option<ServeArgs> {
        if !self.untold.swap(false, Ordering::AcqRel) {
            return None;
        }
        let spot = self.hold_next(0, 0, false)?;
        // There may be more.
        self.untold.store(true, Ordering::Release);
        let port = PortHandle(std::ptr::without_provenance(self.handle.load(Ordering::Acquire)));
        let value = spot.activations.parameter(spot.index).value();
        *hold(&self.told) = Some(spot);
        Some(ServeArgs { port, what: ServeKind::Activation, id: 0, value })
    }

    /// `on_activation` is done.
    pub fn served(&self) {
        let told = hold(&self.told).take();
        if let Some(spot) = told {
            spot.let_go();
        }
    }

    /// Whether it puts from now on. Whoever waits for one that does not is told so; activations stay.
    pub fn set_open(&self, open: Openness) {
        if self.openness() == Openness::Replaced {
            return;
        }
        self.open.store(open as u8, Ordering::SeqCst);
        match open.refusal() {
            Some(_) => self.each_client(|activations| activations.ring(Ring::Wait)),
            None if self.waits() => self.ring(),
            None => {}
        }
    }

    /// Its slot is about to be removed or built anew: what was asked of it is over. Any thread.
    pub fn replace(&self) {
        self.open.store(Openness::Replaced as u8, Ordering::SeqCst);
        self.each_client(|activations| activations.end_all(Status::ProviderReplaced));
    }

    /// One client after the other, with nothing held.
    fn each_client(&self, act: impl Fn(&Activations)) {
        let mut after = 0;
        loop {
            let clients = hold(&self.clients);
            let next = clients.iter().find(|known| known.number > after);
            let Some((number, activations)) = next.map(|known| (known.number, Arc::clone(&known.activations))) else {
                return;
            };
            drop(clients);
            act(&activations);
            after = number;
        }
    }

    /// The instance failed. Its activations wait for its successor; only a parameter that it may have left half-changed, and
    /// that owns memory, is nobody's any more.
    pub fn fail(&self) {
        self.served();
        let left = hold(&self.test).take();
        let Some(Test { spot, .. }) = left else { return };
        if !is_plain(self.parameter) {
            spot.activations.parameter(spot.index).forget_contents();
            let id = u64::from(spot.generation) << 32 | spot.index as u64;
            // It may be over already.
            let _ = spot.activations.end(id, Status::ProviderGone);
        }
        spot.let_go();
    }
}

impl Drop for EventServer {
    fn drop(&mut self) {
        self.replace();
        self.fail();
    }
}
