//! Where plugins' port calls arrive: handles become safe calls.
//!
//! A handle leads to a place of [`table`](crate::port::table), never to an address: one that is stale, forged or of an instance
//! that was replaced is answered "closed", before anything is locked.
#![allow(unsafe_code, reason = "address of unsafe: a place of the table leads to a port by its address")]

use std::hint::black_box;
use std::mem::MaybeUninit;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use component_sdk::abi::host::HostApi;
use component_sdk::abi::payload::{LoanResult, PortHandle, ReadMode, ReadResult};
use component_sdk::port::Sent;

use super::block::Block;
use super::event_in::EventIn;
use super::input::InPort;
use super::output::{Borrower, OutPort};
use super::pattern::event_client::EventClient;
use super::pattern::event_server::EventServer;
use super::pattern::provider::Provider;
use super::pattern::requestor::Requestor;
use super::table::{self, Claim, Kind, Place};
use super::{border_calls, border_events, border_links, border_pushes, devices};
use crate::model::limits::HEADROOM_BYTES;
use crate::plugin::{host, task};
use crate::sys::{arch, seat};

/// One end of a slot's port.
#[derive(Clone)]
pub enum PortEnd {
    /// Receives.
    In(Arc<InPort>),
    /// Sends.
    Out(Arc<OutPort>),
    /// Asks.
    Requestor(Arc<Requestor>),
    /// Answers.
    Provider(Arc<Provider>),
    /// Is told of events.
    EventClient(Arc<EventClient>),
    /// Tells of events.
    EventServer(Arc<EventServer>),
    /// Receives every event.
    EventIn(Arc<EventIn>),
    /// Sends events.
    EventOut(Arc<OutPort>),
}

impl PortEnd {
    /// The port's name.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::In(port) => &port.name,
            Self::Out(port) => &port.name,
            Self::Requestor(port) => &port.name,
            Self::Provider(port) => &port.name,
            Self::EventClient(port) => &port.name,
            Self::EventServer(port) => &port.name,
            Self::EventIn(port) => &port.port.name,
            Self::EventOut(port) => &port.name,
        }
    }

    /// What tells it from every other port that there is.
    #[must_use]
    pub fn address(&self) -> usize {
        match self {
            Self::In(port) => Arc::as_ptr(port).addr(),
            Self::Out(port) => Arc::as_ptr(port).addr(),
            Self::Requestor(port) => Arc::as_ptr(port).addr(),
            Self::Provider(port) => Arc::as_ptr(port).addr(),
            Self::EventClient(port) => Arc::as_ptr(port).addr(),
            Self::EventServer(port) => Arc::as_ptr(port).addr(),
            // As its handles lead to its queue.
            Self::EventIn(port) => Arc::as_ptr(&port.port).addr(),
            Self::EventOut(port) => Arc::as_ptr(port).addr(),
        }
    }

    /// True of the ends at which something comes in: values, requests, events.
    #[must_use]
    pub const fn receives(&self) -> bool {
        matches!(self, Self::In(_) | Self::Provider(_) | Self::EventClient(_) | Self::EventIn(_))
    }
}

/// One instance's access to one port: at rest while the instance stands ready, open while it is in use, closed for good
/// when it was replaced.
pub struct Binding {
    claim: Claim,
    // What the place leads to; freed with the binding, unless somebody is inside.
    end: Option<PortEnd>,
    // Shared as the ends are: who moves a box says that nobody else has its address.
    scratch: Option<Arc<Block>>,
}

impl Binding {
    /// A binding of that instance, at rest; `None`: there are too many handles.
    #[must_use]
    pub fn new(end: PortEnd, owner: u64) -> Option<Self> {
        let claim = Claim::new()?;
        let place = claim.place()?;
        let (address, kind, scratch) = match &end {
            PortEnd::In(port) => (Arc::as_ptr(port).cast::<()>(), Kind::RestingIn, None),
            PortEnd::Out(port) | PortEnd::EventOut(port) => {
                (Arc::as_ptr(port).cast(), Kind::RestingOut, Some(Arc::new(Block::new(port.object))))
            }
            PortEnd::Requestor(port) => (Arc::as_ptr(port).cast(), Kind::RestingCalls, None),
            PortEnd::Provider(port) => (Arc::as_ptr(port).cast(), Kind::RestingCalls, None),
            PortEnd::EventClient(port) => (Arc::as_ptr(port).cast(), Kind::RestingCalls, None),
            PortEnd::EventServer(port) => (Arc::as_ptr(port).cast(), Kind::RestingCalls, None),
            PortEnd::EventIn(port) => (Arc::as_ptr(&port.port).cast(), Kind::RestingIn, None),
        };
        let lent = scratch.as_ref().map_or(std::ptr::null(), Arc::as_ptr);
        place.owner.store(owner, Ordering::Relaxed);
        place.instance.store(owner, Ordering::Relaxed);
        place.port.store(address.cast_mut(), Ordering::Relaxed);
        place.scratch.store(lent.cast_mut().cast(), Ordering::Relaxed);
        claim.set(kind);
        Some(Self { claim, end: Some(end), scratch })
    }

    /// What the component is given.
    #[must_use]
    pub fn handle(&self) -> PortHandle {
        self.claim.handle()
    }

    /// Fetches what a take-over writes to.
    pub fn bring_near(&self) {
        if let Some(place) = self.claim.place() {
            arch::bring_near(std::ptr::from_ref(place).addr(), size_of::<Place>());
        }
    }

    /// From now on calls reach the port.
    pub fn open(&self) {
        match &self.end {
            Some(PortEnd::In(port)) => {
                self.claim.set(Kind::In);
                port.subscriber().into_iter().for_each(|subscriber| subscriber.bind(self.claim.handle()));
            }
            Some(PortEnd::Out(port) | PortEnd::EventOut(port)) => {
                self.claim.set(Kind::Out);
                port.outlet().bind(self.claim.handle());
            }
            Some(PortEnd::Requestor(_)) => self.claim.set(Kind::Requestor),
            Some(PortEnd::Provider(port)) => {
                self.claim.set(Kind::Provider);
                port.bind(self.claim.handle());
            }
            Some(PortEnd::EventClient(port)) => {
                self.claim.set(Kind::EventClient);
                port.bind(self.claim.handle());
            }
            Some(PortEnd::EventServer(port)) => {
                self.claim.set(Kind::EventServer);
                port.bind(self.claim.handle());
            }
            Some(PortEnd::EventIn(port)) => {
                self.claim.set(Kind::In);
                port.bind(self.claim.handle());
            }
            None => {}
        }
    }

    /// From now on every call says that the port is closed.
    pub fn close(&self) {
        self.claim.set(Kind::Closed);
    }

    /// The instance trapped: what it left in a scratch may be half an object, which nobody may drop.
    pub fn forget_scratch(&self) {
        if let Some(block) = &self.scratch {
            block.forget_contents();
        }
    }
}

impl Drop for Binding {
    fn drop(&mut self) {
        if !self.claim.release() {
            // A thread of the component is inside and may never come out: what it uses stays.
            #[allow(clippy::mem_forget, reason = "a thread that the component started is using it")]
            std::mem::forget((self.end.take(), self.scratch.take()));
        }
    }
}

/// What every plugin is given.
pub static HOST: HostApi = HostApi {
    clock: host::clock_now,
    log: host::log,
    raise_fault: host::raise_fault,
    note_error: host::note_error,
    note_panic: host::note_panic,
    note_injection: host::note_injection,
    critical: host::critical,
    loan,
    publish,
    give_back,
    read,
    safe_output: host::safe_output,
    sleep: host::sleep,
    calls: border_calls::API,
    events: border_events::API,
    links: border_links::API,
    tasks: task::API,
    pushes: border_pushes::API,
    devices: devices::API,
};

/// What a handle leads to.
pub(super) enum End<'a> {
    Closed,
    Nowhere,
    Scratch(&'a Block),
    In(&'a InPort),
    Out(&'a OutPort),
    Idle,
    Requestor(&'a Requestor),
    Provider(&'a Provider),
    EventClient(&'a EventClient),
    EventServer(&'a EventServer),
}

impl End<'_> {
    /// As [`PortEnd::address`]; `None` where it leads to no port.
    pub(super) fn address(&self) -> Option<usize> {
        Some(match self {
            Self::Closed | Self::Nowhere | Self::Scratch(_) | Self::Idle => return None,
            Self::In(port) => std::ptr::from_ref(*port).addr(),
            Self::Out(port) => std::ptr::from_ref(*port).addr(),
            Self::Requestor(port) => std::ptr::from_ref(*port).addr(),
            Self::Provider(port) => std::ptr::from_ref(*port).addr(),
            Self::EventClient(port) => std::ptr::from_ref(*port).addr(),
            Self::EventServer(port) => std::ptr::from_ref(*port).addr(),
        })
    }
}

/// Calls `act` with what the handle leads to. The one way in: nothing is locked before it.
#[inline]
pub(super) fn visit<R>(handle: PortHandle, act: impl FnOnce(End<'_>, Borrower) -> R) -> R {
    make_sure_of_stack();
    let Some((place, kind)) = table::find(handle) else { return act(End::Closed, Borrower::Other) };
    if kind != Kind::Closed && place.owner.load(Ordering::Relaxed) == seat::entered() {
        // SAFETY: the handle is of the instance whose callback runs on this thread; its binding is dropped by the
        // thread that enters the instance, which is this one.
        return act(unsafe { end(place, kind) }, Borrower::Callback);
    }
    if !place.enter(handle) {
        return act(End::Closed, Borrower::Other);
    }
    // The kind again: it may have changed before the place was entered.
    let kind = table::find(handle).map_or(Kind::Closed, |(_, kind)| kind);
    let borrower = visitor(place, kind);
    // SAFETY: the binding keeps what the place leads to as long as somebody is inside.
    let result = act(unsafe { end(place, kind) }, borrower);
    place.leave();
    result
}

/// # Safety
/// The binding of this place must be held until the result is not used any more.
#[inline]
unsafe fn end(place: &Place, kind: Kind) -> End<'_> {
    let (port, scratch) = (place.port.load(Ordering::Relaxed), place.scratch.load(Ordering::Relaxed));
    // SAFETY: `Binding::new` stored addresses of these types with these kinds, and holds what they lead to; the scratch of
    // an output is never null.
    unsafe {
        match kind {
            Kind::Closed => End::Closed,
            Kind::RestingIn => End::Nowhere,
            Kind::RestingOut => End::Scratch(&*scratch.cast::<Block>()),
            Kind::In => End::In(&*port.cast::<InPort>()),
            Kind::Out => End::Out(&*port.cast::<OutPort>()),
            Kind::RestingCalls => End::Idle,
            Kind::Requestor => End::Requestor(&*port.cast::<Requestor>()),
            Kind::Provider => End::Provider(&*port.cast::<Provider>()),
            Kind::EventClient => End::EventClient(&*port.cast::<EventClient>()),
            Kind::EventServer => End::EventServer(&*port.cast::<EventServer>()),
        }
    }
}

/// As [`visit`], for a task that wants something of a port of its instance, whoever uses that: it is not taken.
pub(super) fn visit_beside<R>(handle: PortHandle, act: impl FnOnce(End<'_>) -> R) -> R {
    make_sure_of_stack();
    let is_own =
        |place: &Place| seat::task().is_some_and(|task| task.instance == place.instance.load(Ordering::Relaxed));
    let Some((place, _)) = table::find(handle).filter(|(place, _)| is_own(place)) else { return act(End::Closed) };
    if !place.enter(handle) {
        return act(End::Closed);
    }
    let kind = table::find(handle).map_or(Kind::Closed, |(_, kind)| kind);
    // SAFETY: the binding keeps what the place leads to as long as somebody is inside.
    let result = act(unsafe { end(place, kind) });
    place.leave();
    result
}

/// In a place's owner: a task that the port was moved into. No instance's number is that large.
const MOVED: u64 = 1 << 63;

/// Who it is that comes from another thread than the callbacks'. A port is a task's from the moment in which that uses it
/// first, and nobody else's any more; but queries that a server holds may be answered from anywhere in the component.
fn visitor(place: &Place, kind: Kind) -> Borrower {
    let Some(task) = seat::task() else { return Borrower::Other };
    let (moved, owner) = (task.number | MOVED, place.owner.load(Ordering::Relaxed));
    let is_own = owner == moved
        || owner == task.instance
            && (kind == Kind::Provider
                || place.owner.compare_exchange(owner, moved, Ordering::AcqRel, Ordering::Relaxed).is_ok());
    if is_own { Borrower::Task } else { Borrower::Other }
}

/// A stack that is about to overflow does so here, where nothing is locked, and not inside.
#[inline(never)]
pub(super) fn make_sure_of_stack() {
    black_box(&MaybeUninit::<[u8; HEADROOM_BYTES]>::uninit());
}

extern "C" fn loan(handle: PortHandle) -> LoanResult {
    visit(handle, |end, borrower| match end {
        End::Out(port) => port.loan(borrower),
        End::Scratch(block) => LoanResult { value: block.value(), initialised: block.is_filled() },
        _ => LoanResult::CLOSED,
    })
}

extern "C" fn publish(handle: PortHandle, value: *mut u8) -> u32 {
    let sent = visit(handle, |end, borrower| match end {
        End::Out(port) => port.publish(value, borrower),
        End::Scratch(block) => {
            block.fill(0);
            Sent::Unconnected
        }
        _ => Sent::Closed,
    });
    sent as u32
}

extern "C" fn give_back(handle: PortHandle, value: *mut u8) {
    visit(handle, |end, borrower| match end {
        End::Out(port) => port.give_back(value, borrower),
        End::Scratch(block) => block.fill(0),
        _ => {}
    });
}

extern "C" fn read(handle: PortHandle, mode: ReadMode) -> ReadResult {
    visit(handle, |end, borrower| match end {
        End::In(port) => port.read(mode, borrower),
        _ => ReadResult::NONE,
    })
}

#[cfg(test)]
mod tests {
    use component_sdk::object::CommObject;
    use proptest::prelude::*;

    use super::super::check::Checks;
    use super::*;
    use crate::profile::plan::Queue;

    fn closed(handle: PortHandle) -> bool {
        let value = std::ptr::without_provenance_mut(64);
        give_back(handle, value);
        loan(handle).value.is_null()
            && publish(handle, value) == Sent::Closed as u32
            && read(handle, ReadMode::Newest).value.is_null()
    }

    #[test]
    fn a_binding_rests_is_opened_and_closed_for_good() {
        let port = Arc::new(OutPort::new("out", u64::DESCRIPTOR, Checks::default()));
        let binding = Binding::new(PortEnd::Out(Arc::clone(&port)), u64::MAX).unwrap();
        let handle = binding.handle();
        let lent = loan(handle);
        assert!(!lent.value.is_null() && publish(handle, lent.value) == Sent::Unconnected as u32);
        assert!(loan(handle).initialised, "the scratch is lent again");
        binding.open();
        assert_ne!(loan(handle).value, lent.value);
        binding.close();
        assert!(closed(handle));
        drop(binding);
        assert!(closed(handle));
        assert_eq!(Arc::strong_count(&port), 1, "nothing is left behind");
    }

    #[test]
    fn an_input_at_rest_reads_as_empty_and_cannot_be_written() {
        let port = Arc::new(InPort::new("in", u64::DESCRIPTOR, Queue::Last, Checks::default()));
        let binding = Binding::new(PortEnd::In(port), u64::MAX).unwrap();
        assert!(closed(binding.handle()));
        binding.open();
        assert!(loan(binding.handle()).value.is_null());
    }

    proptest! {
        #[test]
        fn a_forged_handle_is_a_closed_port(bits: usize) {
            prop_assert!(closed(PortHandle(std::ptr::without_provenance(bits))));
        }
    }
}
