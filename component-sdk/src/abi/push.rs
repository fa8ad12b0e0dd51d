//! Push ports crossing the border: subscriptions, waits for the next value, cycles of timed servers. Values themselves go
//! the way of all data (see [`payload`](crate::abi::payload)).
#![allow(unsafe_code, reason = "address of unsafe: typed access to a value that the daemon shows")]

use abi_stable::StableAbi;

use super::calls::{Incoming, ServeKind, Wait, Whose};
use super::host;
use super::payload::PortHandle;
use crate::object::CommObject;
use crate::port::{PushClient, PushTimedServer};
use crate::status::Status;

/// Which end of a push a port is. All of one direction may be connected to all of the other.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum PushEnd {
    /// A data port: the connection is the subscription.
    Data,
    /// A push port: clients subscribe.
    Push,
    /// A server with a cycle, which is started and stopped.
    Timed,
}

/// What a push port says about itself.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub struct PushDecl {
    /// Which end it is.
    pub end: PushEnd,
    /// Cycle of a timed server in nanoseconds; 0: none.
    pub period_ns: u64,
    /// A timed server starts with its slot.
    pub started: bool,
    /// Least time between two values that a server sends, in nanoseconds; what comes earlier is not sent.
    pub min_cycle_ns: u64,
    /// Every n-th arrival enters a client's handler; 0: there is none.
    pub prescale: u32,
}

impl PushDecl {
    /// Of a data port, and of ports of other patterns.
    pub const DATA: Self = Self { end: PushEnd::Data, period_ns: 0, started: false, min_cycle_ns: 0, prescale: 0 };
}

/// A value that a client is shown, or why there is none.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct Update {
    /// The object; null with any status but 0.
    pub value: *const u8,
    /// Monotonic time of the `put` in nanoseconds.
    pub stamp_ns: u64,
    /// 0, or the code of a [`Status`].
    pub status: u32,
}

impl Update {
    /// None, for that reason.
    #[must_use]
    pub const fn refused(status: Status) -> Self {
        Self { value: std::ptr::null(), stamp_ns: 0, status: status.code() }
    }
}

/// What a client is told of its server.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub struct PushInfo {
    /// Its cycle in nanoseconds; 0: it has none.
    pub period_ns: u64,
    /// It sends what is put.
    pub running: bool,
    /// 0, or the code of a [`Status`].
    pub status: u32,
}

impl PushInfo {
    /// Nothing, for that reason.
    #[must_use]
    pub const fn refused(status: Status) -> Self {
        Self { period_ns: 0, running: false, status: status.code() }
    }
}

/// The functions of the daemon that make up the push pattern. All of them belong into a callback of the instance whose port
/// it is; on a thread of its own a component gets [`Status::NotAllowed`].
#[repr(C)]
#[derive(StableAbi, Clone, Copy)]
pub struct PushApi {
    /// Client: wants every n-th value from now on.
    pub subscribe: extern "C" fn(port: PortHandle, prescale: u32) -> u32,
    /// Client: wants no values any more.
    pub unsubscribe: extern "C" fn(port: PortHandle) -> u32,
    /// Client: shows the newest value; where it is to wait, the next one.
    pub update: extern "C" fn(port: PortHandle, wait: Wait) -> Update,
    /// Client: asks about its server.
    pub info: extern "C" fn(port: PortHandle) -> PushInfo,
    /// Client: whether this port may wait, for itself or as one of its component's.
    pub blocking: extern "C" fn(port: PortHandle, whose: Whose, on: bool) -> u32,
    /// Timed server: begins its cycle.
    pub start: extern "C" fn(port: PortHandle) -> u32,
    /// Timed server: ends its cycle.
    pub stop: extern "C" fn(port: PortHandle) -> u32,
}

impl PushApi {
    /// Where there is no daemon: every port is closed.
    pub const CLOSED: Self = Self {
        subscribe: closed::subscribe,
        unsubscribe: closed::code,
        update: closed::update,
        info: closed::info,
        blocking: closed::blocking,
        start: closed::code,
        stop: closed::code,
    };
}

mod closed {
    use super::{PortHandle, PushInfo, Status, Update, Wait, Whose};

    const CODE: u32 = Status::Closed.code();

    pub(super) extern "C" fn subscribe(_: PortHandle, _: u32) -> u32 {
        CODE
    }
    pub(super) extern "C" fn code(_: PortHandle) -> u32 {
        CODE
    }
    pub(super) extern "C" fn update(_: PortHandle, _: Wait) -> Update {
        Update::refused(Status::Closed)
    }
    pub(super) extern "C" fn info(_: PortHandle) -> PushInfo {
        PushInfo::refused(Status::Closed)
    }
    pub(super) extern "C" fn blocking(_: PortHandle, _: Whose, _: bool) -> u32 {
        CODE
    }
}

/// Functions of the daemon, by their names.
pub(crate) fn api() -> &'static PushApi {
    &host::get().pushes
}

/// The newest value of a client, or the next one.
///
/// # Errors
/// The status with which nothing is shown.
pub(crate) fn update<T: CommObject>(port: &mut PortHandle, wait: Wait) -> Result<&T, Status> {
    let update = (api().update)(*port, wait);
    Status::check(update.status)?;
    // SAFETY: the daemon compared the layouts of `T` at both ends when they were connected, shows only blocks that a server
    // has filled, and keeps this one alive and unwritten until the next update of this port, which needs the `&mut` that
    // the returned borrow holds.
    unsafe { update.value.cast::<T>().as_ref() }.ok_or(Status::Error)
}

impl<'a> Incoming<'a> {
    /// The value, if it came in at this port.
    #[must_use]
    pub fn value<T: CommObject>(&self, client: &PushClient<T>) -> Option<&'a T> {
        let args = self.args();
        if args.what != ServeKind::Value || args.port != client.handle() {
            return None;
        }
        // SAFETY: as in `update`; the daemon keeps it until the handler has returned.
        unsafe { args.value.cast::<T>().as_ref() }
    }

    /// Something, if the cycle of this server begins.
    #[must_use]
    pub fn tick<T: CommObject>(&self, server: &PushTimedServer<T>) -> Option<()> {
        let args = self.args();
        (args.what == ServeKind::Tick && args.port == server.handle()).then_some(())
    }
}
