//! One method for each shim: the only caller of plugin code. Always called on a fiber, by [`crate::exec::callback`].
#![allow(unsafe_code, reason = "address of unsafe: an instance may move between threads")]

use std::sync::atomic::{AtomicU64, Ordering};

use abi_stable::std_types::{RSlice, RStr};
use component_sdk::abi::class::{CallArgs, CallStatus, ComponentClass, CreateArgs, CreateResult};
use component_sdk::abi::payload::PortHandle;

/// An object of a component class. Not dropped by itself: [`Instance::destroy`] does it, on a fiber, or nobody: an
/// instance that trapped is never entered again.
pub struct Instance {
    class: &'static ComponentClass,
    object: *mut (),
}

// SAFETY: a component is `Send` (a supertrait of the SDK's `Component`), and the daemon enters an instance from one
// thread at a time, because only its owner can call `enter`, which needs `&mut`.
unsafe impl Send for Instance {}

/// The way into an instance.
#[derive(Clone, Copy)]
pub struct Entry {
    class: &'static ComponentClass,
    object: *mut (),
}

// SAFETY: as of `Instance`.
unsafe impl Send for Entry {}

impl Entry {
    /// Enters a callback.
    pub fn enter(&mut self, args: &CallArgs<'_>) -> CallStatus {
        (self.class.call)(self.object, args)
    }
}

static NUMBERS: AtomicU64 = AtomicU64::new(0);

/// A number that no other instance of the process has.
#[must_use]
pub fn next_number() -> u64 {
    NUMBERS.fetch_add(1, Ordering::Relaxed) + 1
}

impl Instance {
    /// Builds one.
    ///
    /// # Errors
    /// The shim's status and text when the component's constructor failed.
    pub fn create(
        class: &'static ComponentClass,
        ports: &[PortHandle],
        properties: &[RStr<'_>],
    ) -> Result<Self, (CallStatus, String)> {
        let args = CreateArgs { ports: RSlice::from_slice(ports), properties: RSlice::from_slice(properties) };
        let CreateResult { instance, status, error } = (class.create)(&args);
        if status == CallStatus::Done && !instance.is_null() {
            Ok(Self { class, object: instance })
        } else {
            Err((status, error.into()))
        }
    }

    /// Its class.
    #[must_use]
    pub const fn class(&self) -> &'static ComponentClass {
        self.class
    }

    /// Where it lies.
    #[must_use]
    pub fn address(&self) -> usize {
        self.object.expose_provenance()
    }

    /// Enters a callback.
    pub fn enter(&mut self, args: &CallArgs<'_>) -> CallStatus {
        (self.class.call)(self.object, args)
    }

    /// The way in, for a callback that may wait: it outlives the borrow of the instance, which nobody else enters
    /// meanwhile.
    #[must_use]
    pub const fn entry(&self) -> Entry {
        Entry { class: self.class, object: self.object }
    }

    /// Drops the object.
    pub fn destroy(&mut self) -> CallStatus {
        let object = std::mem::replace(&mut self.object, std::ptr::null_mut());
        if object.is_null() { CallStatus::Done } else { (self.class.drop)(object) }
    }
}
