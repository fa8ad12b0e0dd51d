//! Event inputs of OPRoS: every event of every output that is connected, in order. An input port whose queue is emptied by
//! callbacks that are entered for it.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use component_sdk::abi::calls::{ServeArgs, ServeKind};
use component_sdk::abi::class::Hook;
use component_sdk::abi::payload::PortHandle;

use super::block::Sample;
use super::input::{InPort, Listener};
use crate::sys::bell::{Ring, Signal, Wakes};

/// An event input of a slot.
pub struct EventIn {
    /// Its queue.
    pub port: Arc<InPort>,
    /// It has a handler of its own; else `on_event` is entered, which takes what is there.
    handled: bool,
    /// The handle of the instance in use.
    handle: AtomicUsize,
    /// What the handler is entered for.
    serving: Mutex<Option<Sample>>,
    /// Events that were there when `on_event` was entered last.
    offered: AtomicUsize,
    /// One arrived since.
    news: Arc<AtomicBool>,
}

/// Has an event looked at.
struct Chime {
    signal: Arc<Signal>,
    news: Arc<AtomicBool>,
}

impl Listener for Chime {
    fn data_arrived<'a>(&'a self, wakes: &mut Wakes<'a>) {
        self.news.store(true, Ordering::Release);
        self.signal.ring_among(Ring::Serve.into(), wakes);
    }
}

/// A callback that is due.
pub struct Due {
    /// Which one.
    pub hook: Hook,
    /// What is to be served, for `Serve`.
    pub serve: ServeArgs,
}

impl EventIn {
    /// Of that queue.
    #[must_use]
    pub fn new(port: InPort, handled: bool) -> Self {
        Self {
            port: Arc::new(port),
            handled,
            handle: AtomicUsize::new(0),
            serving: Mutex::default(),
            offered: AtomicUsize::new(0),
            news: Arc::default(),
        }
    }

    /// Says who is rung when an event arrives; once.
    pub fn listen(&self, signal: Arc<Signal>) {
        self.port.listen(Box::new(Chime { signal, news: Arc::clone(&self.news) }));
    }

    /// From now on the instance with this handle is entered.
    pub fn bind(&self, handle: PortHandle) {
        self.handle.store(handle.0.addr(), Ordering::Release);
    }

    /// True when an event waits that is not to be passed over: `on_event` is asked again as long as it takes one each time.
    #[must_use]
    pub fn waits(&self) -> bool {
        let queued = self.port.queued();
        let is_taken = || queued < self.offered.load(Ordering::Relaxed);
        queued > 0 && (self.handled || self.news.load(Ordering::Acquire) || is_taken())
    }

    /// The callback for the next event.
    pub fn next(&self) -> Option<Due> {
        if self.handled {
            let event = self.port.take_next()?;
            let port = PortHandle(std::ptr::without_provenance(self.handle.load(Ordering::Acquire)));
            let serve = ServeArgs { port, what: ServeKind::Event, id: 0, value: event.value() };
            self.keep(Some(event));
            return Some(Due { hook: Hook::Serve, serve });
        }
        self.news.store(false, Ordering::Release);
        let queued = self.port.queued();
        self.offered.store(queued, Ordering::Relaxed);
        (queued > 0).then_some(Due { hook: Hook::Event, serve: ServeArgs::NONE })
    }

    /// The handler is done.
    pub fn served(&self) {
        self.keep(None);
    }

    fn keep(&self, event: Option<Sample>) {
        let mut serving = self.serving.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut *serving, event);
        drop(serving);
        // Here, where nothing is held: the last holder of an object frees the memory of a plugin.
        drop(before);
    }
}
