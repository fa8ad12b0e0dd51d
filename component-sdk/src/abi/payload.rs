//! Objects crossing the border: blocks that the daemon owns and whose contents only plugin code builds and drops.
//!
//! The writer's code drops a block's old contents when it fills the block anew. So the glue that frees a plugin's memory
//! runs in a guarded callback of a plugin. (What is left in the blocks of a port that is removed is freed by description,
//! by whoever held it last.)
#![allow(unsafe_code, reason = "address of unsafe: typed access to the daemon's blocks")]

use std::marker::PhantomData;

use abi_stable::StableAbi;

use super::host;
use crate::context::Instant;
use crate::object::CommObject;
use crate::port::Sent;

/// A port end, as the daemon knows it.
#[repr(transparent)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortHandle(pub *const ());

impl PortHandle {
    /// Of no port: closed.
    pub const CLOSED: Self = Self(std::ptr::null());
}

// SAFETY: the handle is an address that only the daemon's functions dereference, and those are thread-safe.
unsafe impl Send for PortHandle {}
// SAFETY: as above; a shared handle gives no access by itself.
unsafe impl Sync for PortHandle {}

/// What a read is to do.
#[repr(u8)]
#[derive(StableAbi, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReadMode {
    /// The newest, read before or not.
    Newest,
    /// The newest, if not read before.
    Fresh,
    /// The next of a FIFO.
    Take,
}

/// What a read gives.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct ReadResult {
    /// The object; null: none.
    pub value: *const u8,
    /// Monotonic time of the write in nanoseconds.
    pub stamp_ns: u64,
}

impl ReadResult {
    /// Nothing there.
    pub const NONE: Self = Self { value: std::ptr::null(), stamp_ns: 0 };
}

/// What a loan gives.
#[repr(C)]
#[derive(StableAbi, Clone, Copy, Debug)]
pub struct LoanResult {
    /// Memory of the object's size and alignment; null: the port is closed.
    pub value: *mut u8,
    /// False: the memory holds no object yet.
    pub initialised: bool,
}

impl LoanResult {
    /// The port is closed.
    pub const CLOSED: Self = Self { value: std::ptr::null_mut(), initialised: false };
}

/// An object that an input port lends for as long as the port is borrowed.
pub(crate) struct Received<'a, T> {
    value: &'a T,
    stamp_ns: u64,
}

impl<'a, T> Received<'a, T> {
    pub(crate) fn value(self) -> &'a T {
        self.value
    }

    pub(crate) fn stamp(&self) -> Instant {
        Instant::from_nanos(self.stamp_ns)
    }
}

/// Reads an input port.
pub(crate) fn read<T: CommObject>(port: &mut PortHandle, mode: ReadMode) -> Option<Received<'_, T>> {
    let result = (host::get().read)(*port, mode);
    // SAFETY: the daemon checked at connection that writer and reader agree on the layout of `T`, returns only
    // blocks that a writer has filled, and keeps this one alive and unwritten until the next read of this port,
    // which needs the `&mut` that the returned borrow holds.
    let value = unsafe { result.value.cast::<T>().as_ref() }?;
    Some(Received { value, stamp_ns: result.stamp_ns })
}

/// A block on loan from an output port, holding a valid `T`.
pub(crate) struct RawLoan<'a, T> {
    port: PortHandle,
    value: *mut T,
    borrow: PhantomData<&'a mut PortHandle>,
}

/// Borrows a block to write into; `None`: the port is closed.
pub(crate) fn loan<T: CommObject>(port: &mut PortHandle) -> Option<RawLoan<'_, T>> {
    let lent = (host::get().loan)(*port);
    let value = lent.value.cast::<T>();
    if value.is_null() {
        return None;
    }
    if !lent.initialised {
        // SAFETY: the daemon lends memory of the size and alignment that this port's descriptor, which is `T`'s,
        // asks for, to one borrower at a time; it holds no object yet, so nothing is overwritten.
        unsafe { value.write(T::empty()) };
    }
    Some(RawLoan { port: *port, value, borrow: PhantomData })
}

impl<T> RawLoan<'_, T> {
    pub(crate) fn get(&self) -> &T {
        // SAFETY: `loan` made sure that a valid `T` is there, and nobody else has the block until it is published.
        unsafe { &*self.value }
    }

    pub(crate) fn value(&mut self) -> &mut T {
        // SAFETY: as in `get`; `&mut self` makes the access exclusive.
        unsafe { &mut *self.value }
    }

    pub(crate) fn publish(self) -> Sent {
        let this = std::mem::ManuallyDrop::new(self);
        Sent::from_code((host::get().publish)(this.port, this.value.cast()))
    }
}

impl<T> Drop for RawLoan<'_, T> {
    fn drop(&mut self) {
        (host::get().give_back)(self.port, self.value.cast());
    }
}
