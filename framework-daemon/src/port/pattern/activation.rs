//! What a client of events asked for: a table of activations, each with its parameter and the event that it has not fetched.
//!
//! Both sides share it. The client makes and ends activations, fetches and waits; the server takes one at a time into its
//! test, and fires it. A lock holds the table together for a few instructions in which no memory of a plugin is touched; a
//! word for each side, as calls have them, was the alternative: here either side may end an activation at any moment, in
//! the middle of the other's step.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use component_sdk::abi::events::{Mode, Which};
use component_sdk::object::TypeDescriptor;
use component_sdk::status::Status;
use crossbeam_queue::ArrayQueue;

use crate::port::block::{Block, Sample};
use crate::profile::plan::Overflow;
use crate::sys::bell::{Ring, Signal};

/// How far an activation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Nobody's.
    Free,
    /// Its parameter is being filled.
    Loan,
    /// Tested.
    Active,
}

/// One activation.
struct Place {
    generation: u32,
    state: State,
    mode: Mode,
    /// How often it fired.
    firings: u64,
    /// What was not fetched.
    event: Option<Sample>,
    /// Its parameter is in the server's hands: the place is not used anew meanwhile.
    held: bool,
    /// The server knows of it.
    announced: bool,
    /// Why it ended.
    end: Status,
}

impl Place {
    const fn new() -> Self {
        Self {
            generation: 0,
            state: State::Free,
            mode: Mode::Single,
            firings: 0,
            event: None,
            held: false,
            announced: false,
            end: Status::WrongId,
        }
    }

    fn end(&mut self, why: Status) -> Option<Sample> {
        (self.state, self.end) = (State::Free, why);
        self.event.take()
    }
}

struct Table {
    places: Box<[Place]>,
    /// Somebody tests them.
    connected: bool,
    /// Somebody waits for one of them.
    waited_for: bool,
}

/// An event on its way to the client's handler.
pub(super) struct Firing {
    /// The activation.
    pub(super) id: u64,
    /// What happened.
    pub(super) event: Sample,
}

/// How many there may be, and how many firings may wait for the handler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Room {
    pub(super) activations: usize,
    pub(super) queue: usize,
    pub(super) overflow: Overflow,
    /// There is a handler.
    pub(super) handled: bool,
}

/// The activations of a client port.
pub(super) struct Activations {
    table: Mutex<Table>,
    parameters: Box<[Block]>,
    firings: ArrayQueue<Firing>,
    room: Room,
    signal: OnceLock<Arc<Signal>>,
}

/// What became of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fired {
    /// It is there.
    Kept,
    /// The activation is over, or has fired for the only time.
    Unwanted,
    /// The handler's queue was full, and lost one.
    Lost,
}

fn id_of(generation: u32, index: usize) -> u64 {
    u64::from(generation) << 32 | index as u64
}

impl Activations {
    pub(super) fn new(parameter: &'static TypeDescriptor, room: Room) -> Arc<Self> {
        let places = (0..room.activations).map(|_| Place::new()).collect();
        let parameters = (0..room.activations).map(|_| Block::new(parameter)).collect();
        let table = Mutex::new(Table { places, connected: false, waited_for: false });
        let firings = ArrayQueue::new(room.queue.max(1));
        Arc::new(Self { table, parameters, firings, room, signal: OnceLock::new() })
    }

    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn listen(&self, signal: Arc<Signal>) {
        let _ = self.signal.set(signal);
    }

    pub(super) fn ring(&self, why: Ring) {
        if let Some(signal) = self.signal.get() {
            signal.ring(why);
        }
    }

    /// Events that a client can hold: unfetched ones, those that wait for the handler, and those that are looked at.
    pub(super) fn capacity(&self) -> usize {
        self.room.activations + if self.room.handled { self.room.queue + 1 } else { 0 } + 1
    }

    pub(super) const fn room(&self) -> Room {
        self.room
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.table().places.iter().filter(|place| place.state == State::Active).count()
    }

    /// Client: an activation whose parameter is to be filled, and where.
    pub(super) fn claim(&self) -> Result<(u64, &Block), Status> {
        let mut table = self.table();
        if !table.connected {
            return Err(Status::Disconnected);
        }
        let free = |place: &Place| place.state == State::Free && !place.held;
        let index = table.places.iter().position(free).ok_or(Status::Overload)?;
        let place = &mut table.places[index];
        // Never 0: no number of an activation is.
        let generation = place.generation.wrapping_add(1).max(1);
        *place = Place { generation, state: State::Loan, ..Place::new() };
        Ok((id_of(generation, index), &self.parameters[index]))
    }

    /// Client: the one on loan is tested from now on.
    pub(super) fn activate(&self, id: u64, mode: Mode) -> Result<(), Status> {
        let mut table = self.table();
        let connected = table.connected;
        let place = table.place(id).filter(|place| place.state == State::Loan).ok_or(Status::WrongId)?;
        // Whole: its borrower gives it back.
        self.parameters[id as u32 as usize].fill(0);
        place.mode = mode;
        place.state = if connected { State::Active } else { State::Free };
        if connected { Ok(()) } else { Err(Status::Disconnected) }
    }

    /// Ends one; whoever waits for it is told why.
    pub(super) fn end(&self, id: u64, why: Status) -> Result<(), Status> {
        let mut table = self.table();
        let place = table.place(id).filter(|place| place.state != State::Free).ok_or(Status::WrongId)?;
        let event = place.end(why);
        drop(table);
        self.ring(Ring::Wait);
        // Here, where nothing is held: the last holder of an object frees the memory of a plugin.
        drop(event);
        Ok(())
    }

    /// Ends all that are tested.
    pub(super) fn end_all(&self, why: Status) {
        for index in 0..self.room.activations {
            let mut table = self.table();
            let place = &mut table.places[index];
            let event = if place.state == State::Active { place.end(why) } else { None };
            drop(table);
            drop(event);
        }
        self.ring(Ring::Wait);
    }

    /// The client's instance is gone, and what it had on loan half an object.
    pub(super) fn forget(&self) {
        let mut table = self.table();
        table.waited_for = false;
        let lent = table.places.iter_mut().zip(&self.parameters).filter(|(place, _)| place.state == State::Loan);
        for (place, parameter) in lent {
            parameter.forget_contents();
            place.state = State::Free;
        }
        drop(table);
        self.end_all(Status::NotActivated);
        while let Some(firing) = self.firings.pop() {
            drop(firing);
        }
    }

    /// Whether somebody tests them from now on.
    pub(super) fn set_connected(&self, connected: bool) {
        self.table().connected = connected;
    }

    /// 0 firings or more of one that is tested.
    pub(super) fn firings(&self, id: u64) -> Result<u64, Status> {
        self.table().active(id).map(|place| place.firings)
    }

    /// Client: how far one is; an error where nothing can be fetched, that says why.
    pub(super) fn state(&self, id: u64) -> Result<(), Status> {
        self.table().active(id).and_then(|place| match place.event {
            Some(_) => Ok(()),
            None if place.is_spent() => Err(Status::Passive),
            None => Err(Status::Active),
        })
    }

    /// Client: takes the event that is wanted, if it is there: of one that had fired that often when it was asked first.
    /// Where it is not, and somebody waits, the next one rings.
    pub(super) fn take(&self, id: u64, which: Which, before: u64, waits: bool) -> Result<Option<Sample>, Status> {
        let mut table = self.table();
        let place = table.place(id).ok_or(Status::NotActivated)?;
        if place.state != State::Active {
            return Err(place.end);
        }
        let is_wanted = match which {
            Which::Present => true,
            // A single one that had fired has no next.
            Which::Next if place.mode == Mode::Single && before > 0 => return Err(Status::Passive),
            Which::Next => place.firings > before,
        };
        if let Some(event) = place.event.take_if(|_| is_wanted) {
            return Ok(Some(event));
        }
        if place.is_spent() {
            return Err(Status::Passive);
        }
        table.waited_for |= waits;
        Ok(None)
    }

    /// Client: the next firing for its handler, unless its activation is over.
    pub(super) fn next_firing(&self) -> Option<Firing> {
        loop {
            let firing = self.firings.pop()?;
            if self.firings(firing.id).is_ok() {
                return Some(firing);
            }
        }
    }

    /// Firings that wait for the handler.
    pub(super) fn waiting(&self) -> usize {
        self.firings.len()
    }

    /// Server: the next one from that place on which is in nobody's hands, now in the server's. With `announced`: one that it
    /// knows of already; else one that it does not, which it knows from then on.
    pub(super) fn hold(&self, from: usize, announced: bool) -> Option<(usize, u32)> {
        let mut table = self.table();
        let due = |place: &Place| place.state == State::Active && !place.held && place.announced == announced;
        let index = from + table.places.get(from..)?.iter().position(due)?;
        let place = &mut table.places[index];
        (place.held, place.announced) = (true, true);
        Some((index, place.generation))
    }

    /// Server: it is out of the server's hands.
    pub(super) fn let_go(&self, index: usize) {
        if let Some(place) = self.table().places.get_mut(index) {
            place.held = false;
        }
    }

    /// Server: knows of it without being told.
    pub(super) fn know(&self, id: u64) {
        if let Some(place) = self.table().place(id) {
            place.announced = true;
        }
    }

    /// Server: where its parameter lies.
    pub(super) fn parameter(&self, index: usize) -> &Block {
        &self.parameters[index]
    }

    /// Server: tells the client.
    pub(super) fn fire(&self, index: usize, generation: u32, event: &Sample) -> Fired {
        let id = id_of(generation, index);
        let mut table = self.table();
        let Some(place) = table.place(id).filter(|place| place.state == State::Active) else { return Fired::Unwanted };
        if place.mode == Mode::Single && place.firings > 0 {
            return Fired::Unwanted;
        }
        place.firings += 1;
        let before = place.event.replace(Arc::clone(event));
        let waited_for = std::mem::take(&mut table.waited_for);
        drop(table);
        drop(before);
        if waited_for {
            self.ring(Ring::Wait);
        }
        if self.room.handled { self.queue(Firing { id, event: Arc::clone(event) }) } else { Fired::Kept }
    }

    fn queue(&self, firing: Firing) -> Fired {
        let lost = match self.room.overflow {
            Overflow::DropOldest => self.firings.force_push(firing).is_some(),
            Overflow::DropNewest | Overflow::Fault => self.firings.push(firing).is_err(),
        };
        self.ring(Ring::Serve);
        if lost { Fired::Lost } else { Fired::Kept }
    }
}

impl Place {
    /// A single one that fired: its event was fetched.
    fn is_spent(&self) -> bool {
        self.mode == Mode::Single && self.firings > 0 && self.event.is_none()
    }
}

impl Table {
    fn place(&mut self, id: u64) -> Option<&mut Place> {
        let generation = (id >> 32) as u32;
        self.places.get_mut(id as u32 as usize).filter(|place| generation != 0 && place.generation == generation)
    }

    fn active(&mut self, id: u64) -> Result<&Place, Status> {
        self.place(id).filter(|place| place.state == State::Active).map(|place| &*place).ok_or(Status::WrongId)
    }
}
