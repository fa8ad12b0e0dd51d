//! Events crossing the border: a client's parameter lies in a block of the client's port, where its server tests it; an
//! event lies in a block of the server's port, which its clients are lent.
//!
//! A number that is stale, forged or of another port is answered `Status::WrongId`, an instance that was replaced finds its
//! ports `Status::Closed`.
#![allow(unsafe_code, reason = "address of unsafe: typed access to parameters and events")]

use abi_stable::StableAbi;

use super::calls::{Incoming, Lent, ServeKind, Wait, Whose};
use super::host;
use super::payload::PortHandle;
use crate::object::CommObject;
use crate::port::{EventClient, EventId, EventIn, EventServer};
use crate::status::Status;

/// How often an activation fires.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Once.
    Single,
    /// Until it is deactivated.
    Continuous,
}

/// Which event a client wants.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// The one that is there, or else the next.
    Present,
    /// The next, whatever is there.
    Next,
}

/// An activation whose test is due, or why there is none.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct Testing {
    /// The activation's parameter, a valid object; null with any status but 0.
    pub parameter: *mut u8,
    /// Memory for the event.
    pub event: *mut u8,
    /// Number of the test.
    pub id: u64,
    /// 0; `NoData` when all were tested; or the code of another [`Status`], when nothing is tested any more.
    pub status: u32,
    /// False: the memory for the event holds no object yet.
    pub initialised: bool,
}

impl Testing {
    /// Nothing, for that reason.
    #[must_use]
    pub const fn over(status: Status) -> Self {
        let nothing = std::ptr::null_mut();
        Self { parameter: nothing, event: nothing, id: 0, status: status.code(), initialised: false }
    }
}

/// The functions of the daemon that make up the event pattern. All of them belong into a callback of the instance whose
/// port it is; on a thread of its own a component gets [`Status::NotAllowed`].
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct EventApi {
    /// Client: lends an activation and the block for its parameter.
    pub loan: extern "C" fn(port: PortHandle) -> Lent,
    /// Client: makes the activation on loan one.
    pub activate: extern "C" fn(port: PortHandle, id: u64, mode: Mode) -> u32,
    /// Client: ends an activation, or gives one on loan back.
    pub deactivate: extern "C" fn(port: PortHandle, id: u64) -> u32,
    /// Client: 0 when it fired and that was not fetched; `Active`, `Passive`.
    pub state: extern "C" fn(port: PortHandle, id: u64) -> u32,
    /// Client: fetches an event, waits for it if asked to. It stays until the next one is fetched.
    pub fetch: extern "C" fn(port: PortHandle, id: u64, which: Which, wait: Wait) -> Lent,
    /// Client: whether this port may wait, for itself or as one of its component's.
    pub blocking: extern "C" fn(port: PortHandle, whose: Whose, on: bool) -> u32,
    /// Server: the first activation to be tested.
    pub first: extern "C" fn(port: PortHandle) -> Testing,
    /// Server: says how a test ended; the next activation to be tested.
    pub next: extern "C" fn(port: PortHandle, id: u64, fires: bool) -> Testing,
    /// Server: gives a test up, and all that would follow.
    pub leave: extern "C" fn(port: PortHandle, id: u64),
}

impl EventApi {
    /// Where there is no daemon: every port is closed.
    pub const CLOSED: Self = Self {
        loan: closed::lent,
        activate: closed::activated,
        deactivate: closed::code,
        state: closed::code,
        fetch: closed::fetched,
        blocking: closed::blocking,
        first: closed::first,
        next: closed::next,
        leave: closed::left,
    };
}

mod closed {
    use super::{Lent, Mode, PortHandle, Status, Testing, Wait, Which, Whose};

    const CODE: u32 = Status::Closed.code();

    pub(super) extern "C" fn lent(_: PortHandle) -> Lent {
        Lent::refused(Status::Closed)
    }
    pub(super) extern "C" fn activated(_: PortHandle, _: u64, _: Mode) -> u32 {
        CODE
    }
    pub(super) extern "C" fn code(_: PortHandle, _: u64) -> u32 {
        CODE
    }
    pub(super) extern "C" fn fetched(_: PortHandle, _: u64, _: Which, _: Wait) -> Lent {
        Lent::refused(Status::Closed)
    }
    pub(super) extern "C" fn blocking(_: PortHandle, _: Whose, _: bool) -> u32 {
        CODE
    }
    pub(super) extern "C" fn first(_: PortHandle) -> Testing {
        Testing::over(Status::Closed)
    }
    pub(super) extern "C" fn next(_: PortHandle, _: u64, _: bool) -> Testing {
        Testing::over(Status::Closed)
    }
    pub(super) extern "C" fn left(_: PortHandle, _: u64) {}
}

/// One test of an activation: ends with it, whatever ends it.
struct Test<P, E> {
    port: PortHandle,
    id: u64,
    parameter: *mut P,
    event: *mut E,
    is_over: bool,
}

impl<P: CommObject, E: CommObject> Test<P, E> {
    fn new(port: PortHandle, testing: &Testing) -> Result<Self, Status> {
        Status::check(testing.status)?;
        let event = testing.event.cast::<E>();
        if !testing.initialised {
            // SAFETY: with status 0 the daemon lends memory of the size and alignment of the port's event, which is `E`, to
            // one borrower at a time; it holds no object yet.
            unsafe { event.write(E::empty()) };
        } else {
            // SAFETY: as above; it holds an earlier event. Fresh for each activation: what one leaves is no other's.
            unsafe { *event = E::empty() };
        }
        Ok(Self { port, id: testing.id, parameter: testing.parameter.cast(), event, is_over: false })
    }

    fn run<S: ?Sized>(&mut self, state: &S, test: &mut impl FnMut(&mut P, &mut E, &S) -> bool) -> bool {
        // SAFETY: the daemon compared the layouts of `P` and `E` when the two ends were connected, shows only parameters that
        // their clients have filled, and leaves both blocks to this test until it is over.
        unsafe { test(&mut *self.parameter, &mut *self.event, state) }
    }

    fn end(mut self, fires: bool) -> Testing {
        self.is_over = true;
        (api().next)(self.port, self.id, fires)
    }
}

impl<P, E> Drop for Test<P, E> {
    fn drop(&mut self) {
        if !self.is_over {
            (api().leave)(self.port, self.id);
        }
    }
}

/// Tests all activations.
///
/// # Errors
/// `Overload`, `NotAllowed`, `Closed`.
pub(crate) fn put<P: CommObject, E: CommObject, S: ?Sized>(
    port: PortHandle,
    state: &S,
    mut test: impl FnMut(&mut P, &mut E, &S) -> bool,
) -> Result<(), Status> {
    let mut testing = (api().first)(port);
    loop {
        let mut due = match Test::<P, E>::new(port, &testing) {
            Ok(due) => due,
            Err(Status::NoData) => return Ok(()),
            Err(status) => return Err(status),
        };
        let fires = due.run(state, &mut test);
        testing = due.end(fires);
    }
}

/// The event that the daemon lent.
///
/// # Errors
/// The status with which nothing was lent.
pub(crate) fn fetched<'a, E: CommObject>(lent: &Lent) -> Result<&'a E, Status> {
    Status::check(lent.status)?;
    shown(lent.value).ok_or(Status::Error)
}

/// An object that the daemon shows. The callers bind the borrow to their port or their callback.
fn shown<'a, T: CommObject>(value: *const u8) -> Option<&'a T> {
    // SAFETY: the daemon compared the layouts of `T` at both ends when they were connected, shows only blocks that were
    // filled, and keeps this one alive and unwritten: an event until the next one is fetched, what a handler is entered for
    // until it returns.
    unsafe { value.cast::<T>().as_ref() }
}

impl<'a> Incoming<'a> {
    /// The event that fired, if it came in at this port, and whose it is.
    #[must_use]
    pub fn firing<P: CommObject, E: CommObject>(&self, client: &EventClient<P, E>) -> Option<(EventId<E>, &'a E)> {
        let (id, value) = self.at(ServeKind::Firing, client.handle())?;
        shown(value).map(|event| (EventId::new(id), event))
    }

    /// The parameter of an activation, if it came in at this port.
    #[must_use]
    pub fn activation<P: CommObject, E: CommObject, S: ?Sized>(&self, server: &EventServer<P, E, S>) -> Option<&'a P> {
        let (_, value) = self.at(ServeKind::Activation, server.handle())?;
        shown(value)
    }

    /// The event, if it came in at this port.
    #[must_use]
    pub fn event<E: CommObject>(&self, port: &EventIn<E>) -> Option<&'a E> {
        let (_, value) = self.at(ServeKind::Event, port.handle())?;
        shown(value)
    }
}

/// Functions of the daemon, by their names.
pub(crate) fn api() -> &'static EventApi {
    &host::get().events
}
