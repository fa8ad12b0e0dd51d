//! Input ports. The newest value only (OPRoS LAST) is one place whose contents are exchanged; a FIFO is a lock-free ring.
//! Any number of writers never wait for a reader or for each other.
//!
//! What the reader looks at is held by one of two: the callbacks of the slot, one thread at a time and without a lock, and
//! threads that a component started, which share the other one. A thread that is given a port of which a callback has read
//! already sees what arrives from then on.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, TryLockError, Weak};

use component_sdk::abi::calls::Wait;
use component_sdk::abi::payload::{ReadMode, ReadResult};
use component_sdk::object::TypeDescriptor;
use component_sdk::status::Status;
use crossbeam_queue::ArrayQueue;

use super::block::{Block, Newest, Sample};
use super::check::Checks;
use super::exchange::{self, Busy};
use super::hearing::Hearing;
use super::output::{Borrower, OutPort};
use super::pattern::outlet::Outlet;
use super::pattern::subscriber::{Subscriber, Turn};
use super::wait::Place;
use crate::model::fault::Fault;
use crate::model::limits::FIFO_SIZE_MAX;
use crate::profile::plan::{Overflow, Queue};
use crate::sys::bell::Wakes;
use crate::sys::{arch, clock};

/// Told when data arrives: wakes a nonperiodic slot.
pub trait Listener: Send + Sync {
    /// Called by the writer's thread; must not block. An executor that is to look at it may be left to `wakes`.
    fn data_arrived<'a>(&'a self, wakes: &mut Wakes<'a>);

    /// Fetches what the next call writes to.
    fn bring_near(&self) {}
}

/// A writer that is connected.
pub type Source = Weak<OutPort>;

/// What has arrived and was not read.
enum Arrived {
    Newest(Newest),
    Fifo(ArrayQueue<Sample>, Overflow),
}

/// Who reads.
enum Reader {
    /// Everything that is sent.
    All,
    /// Every n-th value.
    Some(Turn),
    /// A push client, while it is subscribed.
    Subscriber(Box<Subscriber>),
    /// Nobody who counts: somebody looks at what passes.
    Tap,
}

/// An input port of a slot.
pub struct InPort {
    /// Name.
    pub name: String,
    /// What it carries.
    pub object: &'static TypeDescriptor,
    /// Checks of the port itself.
    pub checks: Checks,
    arrived: Arrived,
    reader: Reader,
    /// Where silence is a fault.
    hearing: Option<Box<Hearing>>,
    // Held while the port is wired: nothing of a plugin is touched meanwhile.
    sources: Mutex<Vec<Source>>,
    listener: OnceLock<Box<dyn Listener>>,
    taken: Taken,
    passed_over: AtomicU64,
    dropped: AtomicU64,
}

/// What its reader writes to. On lines of its own: a writer on another processor would wait for whatever shares them.
#[derive(Default)]
#[repr(align(64))]
struct Taken {
    /// What a callback looks at.
    current: Newest,
    // What a thread of the component looks at. Taken for a few instructions; writers never touch it. Nothing is dropped under
    // it: the last holder of an object frees the memory of a plugin.
    aside: Mutex<Option<Sample>>,
    /// Counted by the reader, so that a writer counts only what is never read.
    count: AtomicU64,
}

impl InPort {
    /// An unconnected port.
    #[must_use]
    pub fn new(name: &str, object: &'static TypeDescriptor, policy: Queue, checks: Checks) -> Self {
        let arrived = match policy {
            Queue::Last => Arrived::Newest(Newest::default()),
            Queue::Fifo { size, overflow } => Arrived::Fifo(ArrayQueue::new(size.clamp(1, FIFO_SIZE_MAX)), overflow),
        };
        Self {
            name: name.to_owned(),
            object,
            checks,
            arrived,
            reader: Reader::All,
            hearing: None,
            sources: Mutex::default(),
            listener: OnceLock::new(),
            taken: Taken::default(),
            passed_over: AtomicU64::new(0),
            dropped: AtomicU64::new(0),
        }
    }

    /// One whose silence for longer than that is a fault of its writers.
    #[must_use]
    pub fn expecting(self, max_age_ns: u64) -> Self {
        Self { hearing: Some(Box::new(Hearing::new(max_age_ns))), ..self }
    }

    /// Its arrivals, where its silence is a fault.
    #[must_use]
    pub fn hearing(&self) -> Option<&Hearing> {
        self.hearing.as_deref()
    }

    /// True where values are to come: it is connected, or its subscription runs.
    #[must_use]
    pub fn is_awaited(&self) -> bool {
        match self.subscriber() {
            Some(subscriber) => subscriber.standing().is_ok(),
            None => self.sources().is_ok_and(|sources| !sources.is_empty()),
        }
    }

    /// Charges the slots of all its writers. False: its connections are being changed all the time.
    pub fn charge_writers(&self, fault: &Fault) -> bool {
        let Ok(sources) = self.sources() else { return false };
        sources.iter().filter_map(Source::upgrade).for_each(|output| _ = output.charge(fault));
        true
    }

    /// One that gets every n-th value only.
    #[must_use]
    pub fn thinned(self, every: u32) -> Self {
        Self { reader: Reader::Some(Turn::new(every.max(1))), ..self }
    }

    /// One of a push client.
    #[must_use]
    pub fn subscribed_by(self, subscriber: Subscriber) -> Self {
        Self { reader: Reader::Subscriber(Box::new(subscriber)), ..self }
    }

    /// One at which somebody looks at what passes. Its writers answer as if it were not there.
    #[must_use]
    pub fn tapping(self) -> Self {
        Self { reader: Reader::Tap, ..self }
    }

    /// True for one at which somebody only looks.
    #[must_use]
    pub const fn is_tap(&self) -> bool {
        matches!(self.reader, Reader::Tap)
    }

    /// True for one that gets everything, and counts.
    #[must_use]
    pub const fn is_plain(&self) -> bool {
        matches!(self.reader, Reader::All)
    }

    /// Its push client, if it is one's.
    #[must_use]
    pub fn subscriber(&self) -> Option<&Subscriber> {
        match &self.reader {
            Reader::Subscriber(subscriber) => Some(subscriber),
            Reader::All | Reader::Some(_) | Reader::Tap => None,
        }
    }

    /// Which values it gets; `None`: all.
    #[must_use]
    pub fn turn(&self) -> Option<&Turn> {
        match &self.reader {
            Reader::All | Reader::Tap => None,
            Reader::Some(turn) => Some(turn),
            Reader::Subscriber(subscriber) => Some(subscriber.turn()),
        }
    }

    /// Sets who is told of arriving data; once.
    pub fn listen(&self, listener: Box<dyn Listener>) {
        let _ = self.listener.set(listener);
    }

    /// How it buffers.
    #[must_use]
    pub fn policy(&self) -> Queue {
        match &self.arrived {
            Arrived::Newest(_) => Queue::Last,
            Arrived::Fifo(queue, overflow) => Queue::Fifo { size: queue.capacity(), overflow: *overflow },
        }
    }

    /// The writers that are connected, and the right to change them.
    ///
    /// # Errors
    /// Somebody else has it all the time.
    pub(super) fn sources(&self) -> Result<MutexGuard<'_, Vec<Source>>, Busy> {
        exchange::patiently(|| match self.sources.try_lock() {
            Ok(sources) => Some(sources),
            Err(TryLockError::Poisoned(sources)) => Some(sources.into_inner()),
            Err(TryLockError::WouldBlock) => None,
        })
    }

    /// How many blocks this port can hold: what is queued, and what its reader looks at.
    #[must_use]
    pub fn capacity(&self) -> usize {
        match &self.arrived {
            Arrived::Newest(_) => 2 + self.subscriber().map_or(0, Subscriber::capacity),
            Arrived::Fifo(queue, _) => queue.capacity() + 1,
        }
    }

    /// True when something waits to be read.
    #[must_use]
    pub fn has_data(&self) -> bool {
        self.queued() > 0
    }

    /// Values that wait to be read.
    #[must_use]
    pub fn queued(&self) -> usize {
        match &self.arrived {
            Arrived::Newest(newest) => usize::from(!newest.is_empty()),
            Arrived::Fifo(queue, _) => queue.len(),
        }
    }

    /// Values received and values lost to a full queue. What a handler did not get arrived all the same, and is no second value.
    #[must_use]
    pub fn counts(&self) -> (u64, u64) {
        let [taken, passed_over, dropped] =
            [&self.taken.count, &self.passed_over, &self.dropped].map(|count| count.load(Ordering::Relaxed));
        let unhandled = self.subscriber().map_or(0, Subscriber::lost);
        (taken + passed_over + dropped + self.queued() as u64, dropped + unhandled)
    }

    /// Takes a value in.
    #[inline]
    pub(super) fn push<'a>(&'a self, sample: Sample, wakes: &mut Wakes<'a>) -> Pushed {
        let pushed = match &self.arrived {
            Arrived::Newest(newest) => {
                if newest.put(sample).is_some() {
                    self.passed_over.fetch_add(1, Ordering::Relaxed);
                }
                Pushed::Kept
            }
            Arrived::Fifo(queue, Overflow::DropOldest) => match queue.force_push(sample) {
                Some(_) => self.lost(Pushed::OldestLost),
                None => Pushed::Kept,
            },
            Arrived::Fifo(queue, overflow) => match queue.push(sample) {
                Ok(()) => Pushed::Kept,
                Err(_) if *overflow == Overflow::Fault => self.lost(Pushed::Overload),
                Err(_) => self.lost(Pushed::NewestLost),
            },
        };
        if let Some(hearing) = &self.hearing {
            hearing.heard();
        }
        if let Some(listener) = self.listener.get() {
            listener.data_arrived(wakes);
        }
        pushed
    }

    /// Fetches what the next value writes to: its reader on another processor has it.
    #[inline]
    pub(super) fn bring_near(&self) {
        arch::fetch_line(std::ptr::from_ref(&self.arrived).addr());
        self.listener.get().into_iter().for_each(|listener| listener.bring_near());
    }

    /// Takes a value in that is its turn, and tells its client.
    pub(super) fn take_in<'a>(&'a self, sample: Sample, wakes: &mut Wakes<'a>) -> Pushed {
        let Some(subscriber) = self.subscriber() else { return self.push(sample, wakes) };
        subscriber.note(&sample);
        let pushed = self.push(sample, wakes);
        subscriber.arrived();
        pushed
    }

    /// That writer is connected.
    pub(super) fn joined(&self, outlet: &Arc<Outlet>) {
        self.expect_anew();
        if let Some(subscriber) = self.subscriber() {
            subscriber.join(outlet);
        }
    }

    /// Whatever it has waited for until now, it waits from now on.
    pub(super) fn expect_anew(&self) {
        if let Some(hearing) = &self.hearing {
            hearing.begin(clock::now_ns());
        }
    }

    /// That writer is not connected any more. A client without a server is not subscribed any more, unless there will be a
    /// successor.
    pub(super) fn parted(&self, outlet: &Arc<Outlet>) {
        let Some(subscriber) = self.subscriber() else { return };
        let is_alone = subscriber.part(outlet);
        if outlet.is_replaced() {
            self.forget();
            subscriber.end_waits(Status::ProviderReplaced);
        } else if is_alone {
            self.end_subscription(Status::Disconnected);
        }
    }

    /// Its server does not send any more, or for the time being: whoever waits is told so.
    pub(super) fn end_waits(&self, status: Status) {
        self.subscriber().into_iter().for_each(|subscriber| subscriber.end_waits(status));
    }

    /// Its client wants no values any more.
    pub fn unsubscribe(&self) {
        self.end_subscription(Status::Unsubscribed);
    }

    /// Its client hears another server from now on, or none.
    pub(super) fn disconnected(&self) {
        self.end_subscription(Status::Disconnected);
    }

    fn end_subscription(&self, status: Status) {
        if let Some(subscriber) = self.subscriber() {
            subscriber.unsubscribe(status);
            self.forget();
        }
    }

    /// What a push client has is dropped.
    pub(super) fn forget(&self) {
        let Some(subscriber) = self.subscriber() else { return };
        subscriber.forget();
        if let Arrived::Newest(newest) = &self.arrived
            && newest.take().is_some()
        {
            self.passed_over.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// The newest value of a push client, or the next one.
    ///
    /// # Errors
    /// Why there is none.
    pub fn update(&self, wait: Wait, borrower: Borrower, place: &impl Place) -> Result<ReadResult, Status> {
        let subscriber = self.subscriber().ok_or(Status::NotAllowed)?;
        match wait {
            Wait::NONE => subscriber.standing()?,
            wait => subscriber.wait(wait, place)?,
        }
        if subscriber.is_outdated() {
            self.forget_shown(borrower);
        }
        let read = self.read(ReadMode::Newest, borrower);
        // Whoever waited for a value that was dropped at once is told why there is none.
        if read.value.is_null() { subscriber.standing().and(Err(Status::NoData)) } else { Ok(read) }
    }

    /// What its reader looks at is of an earlier subscription.
    fn forget_shown(&self, borrower: Borrower) {
        let before = match borrower {
            Borrower::Callback => self.taken.current.take(),
            Borrower::Task | Borrower::Other => self.taken.aside.lock().unwrap_or_else(PoisonError::into_inner).take(),
        };
        drop(before);
    }

    fn lost(&self, how: Pushed) -> Pushed {
        self.dropped.fetch_add(1, Ordering::Relaxed);
        how
    }

    /// The next value of the queue, for whoever looks at it elsewhere.
    pub(super) fn take_next(&self) -> Option<Sample> {
        self.next(ReadMode::Take)
    }

    /// Reads; the object stays valid until the next read.
    #[inline]
    pub fn read(&self, mode: ReadMode, borrower: Borrower) -> ReadResult {
        let next = self.next(mode);
        if next.is_none() && mode != ReadMode::Newest {
            return ReadResult::NONE;
        }
        match borrower {
            Borrower::Callback => self.look(next),
            Borrower::Task | Borrower::Other => self.look_aside(next),
        }
    }

    /// Shows the next value of a FIFO to somebody who is no component, and gives it back.
    pub fn show_next<R>(&self, look: impl FnOnce(Shown) -> R) -> Option<R> {
        let sample = self.next(ReadMode::Take)?;
        Some(look(Shown { address: sample.value().addr(), stamp_ns: sample.stamp_ns() }))
    }

    #[inline]
    fn next(&self, mode: ReadMode) -> Option<Sample> {
        let (next, count) = match &self.arrived {
            Arrived::Newest(newest) => (newest.take(), 1),
            Arrived::Fifo(queue, _) if mode == ReadMode::Take => (queue.pop(), 1),
            Arrived::Fifo(queue, _) => {
                std::iter::from_fn(|| queue.pop()).fold((None, 0), |(_, count), sample| (Some(sample), count + 1))
            }
        };
        if next.is_some() {
            // Not one operation: a count that two readers disturb is less than what each read would take.
            self.taken.count.store(self.taken.count.load(Ordering::Relaxed) + count, Ordering::Relaxed);
        }
        next
    }

    #[inline]
    #[allow(unsafe_code, reason = "what a callback looks at stays where it is meanwhile")]
    fn look(&self, next: Option<Sample>) -> ReadResult {
        if let Some(sample) = next {
            let result = shown(&sample);
            // SAFETY: only callbacks of the slot come here, one thread at a time, and no signal handler that interrupts them.
            drop(unsafe { self.taken.current.put_alone(sample) });
            return result;
        }
        // SAFETY: as above.
        unsafe { self.taken.current.look() }.map_or(ReadResult::NONE, shown)
    }

    fn look_aside(&self, next: Option<Sample>) -> ReadResult {
        let mut aside = self.taken.aside.lock().unwrap_or_else(PoisonError::into_inner);
        let before = next.and_then(|sample| aside.replace(sample));
        let result = aside.as_deref().map_or(ReadResult::NONE, shown);
        drop(aside);
        drop(before);
        result
    }
}

#[inline]
fn shown(block: &Block) -> ReadResult {
    ReadResult { value: block.value(), stamp_ns: block.stamp_ns() }
}

/// A value on show.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// Where it lies.
    pub address: usize,
    /// When it was written, in nanoseconds.
    pub stamp_ns: u64,
}

/// What became of a value at a reader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// It is there.
    Kept,
    /// It is there; the oldest made room.
    OldestLost,
    /// It was lost.
    NewestLost,
    /// It was lost where nothing may be.
    Overload,
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::Arc;

    use component_sdk::object::CommObject;
    use proptest::prelude::*;

    use super::*;

    fn sample(value: u64) -> Sample {
        let block = Block::new(u64::DESCRIPTOR);
        block.fill(value);
        Arc::new(block)
    }

    fn port(policy: Queue) -> InPort {
        InPort::new("in", u64::DESCRIPTOR, policy, Checks::default())
    }

    #[test]
    fn the_newest_value_may_be_read_again() {
        let port = port(Queue::Last);
        assert!(port.read(ReadMode::Newest, Borrower::Callback).value.is_null());
        port.push(sample(1), &mut Wakes::default());
        port.push(sample(2), &mut Wakes::default());
        assert_eq!(port.read(ReadMode::Fresh, Borrower::Callback).stamp_ns, 2);
        assert!(port.read(ReadMode::Fresh, Borrower::Callback).value.is_null());
        assert_eq!(port.read(ReadMode::Newest, Borrower::Callback).stamp_ns, 2);
    }

    proptest! {
        /// A FIFO of each overflow rule against a `VecDeque`.
        #[test]
        fn a_fifo_keeps_order_and_counts_losses(size in 1..6usize, rule in 0..3usize, steps in prop::collection::vec(any::<bool>(), 0..100)) {
            let overflow = [Overflow::DropOldest, Overflow::DropNewest, Overflow::Fault][rule];
            let port = port(Queue::Fifo { size, overflow });
            let (mut model, mut lost) = (VecDeque::new(), 0);
            for (number, write) in (1u64..).zip(steps) {
                if write {
                    port.push(sample(number), &mut Wakes::default());
                    if model.len() == size {
                        lost += 1;
                        if overflow != Overflow::DropOldest { continue; }
                        model.pop_front();
                    }
                    model.push_back(number);
                } else {
                    let read = port.read(ReadMode::Take, Borrower::Callback);
                    prop_assert_eq!((!read.value.is_null()).then_some(read.stamp_ns), model.pop_front());
                }
            }
            prop_assert_eq!(port.counts().1, lost);
        }
    }
}
