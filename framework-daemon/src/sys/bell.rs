//! What makes an executor look at one of its members: data, a request, an answer. Where both sides share an executor the
//! member is only queued and runs when the callback of the other returns or waits: no thread hop.
//!
//! Who rings says why, not what: the member looks at its ports itself. So a ring too many costs a look, and none is lost:
//! an executor looks at its queues before it sleeps.
//!
//! What the executor's own thread rings for has words of its own: an operation that other processors must agree to takes as
//! long as the way into a callback.

use std::sync::Arc;

use super::crowd::Crowd;
use super::lookout::Lookout;
use super::seat;
use super::shared::{ArrayQueue, AtomicBool, AtomicU32, AtomicUsize, Ordering};
use super::wake::Waker;
use crate::model::limits::SLOTS;

/// Room for every slot of a plan on one executor, and for the numbers of members that left while they were in the queue.
pub const MEMBERS_MAX: usize = 2 * SLOTS;

/// What others may touch of an executor.
pub struct Bell {
    waker: Waker,
    lookout: Lookout,
    near: Near,
    far: ArrayQueue<usize>,
    /// The last member came from the others.
    was_far: AtomicBool,
}

impl Bell {
    /// A silent one.
    #[must_use]
    pub fn new() -> Arc<Self> {
        Arc::new(Self {
            waker: Waker::default(),
            lookout: Lookout::default(),
            near: Near::new(),
            far: ArrayQueue::new(MEMBERS_MAX),
            was_far: AtomicBool::new(false),
        })
    }

    /// Says that the calling thread is this executor's.
    pub fn adopt(self: &Arc<Self>) {
        seat::sit_at(Arc::as_ptr(self).cast());
    }

    /// Wakes the executor.
    pub fn wake(&self) {
        self.lookout.wake(&self.waker);
    }

    /// Waits for a wake-up or the deadline; returns at once while somebody is to be looked at.
    pub fn wait_until(&self, deadline_ns: Option<u64>) {
        if self.is_silent() {
            self.lookout.wait_until(&self.waker, deadline_ns);
        }
    }

    /// The next member to look at. Those that others rang for take turns with those that the executor's own thread did, so that
    /// neither waits for ever.
    #[must_use]
    pub fn next_ready(&self) -> Option<usize> {
        if !self.far.is_empty() && (self.near.is_empty() || !self.was_far.load(Ordering::Relaxed)) {
            self.was_far.store(true, Ordering::Relaxed);
            return self.far.pop();
        }
        self.was_far.store(false, Ordering::Relaxed);
        self.near.pop()
    }

    /// True where nobody is to be looked at. On the executor's thread.
    #[inline]
    fn is_silent(&self) -> bool {
        self.near.is_empty() && self.far.is_empty()
    }

    /// True on the executor's thread, in a callback or between two: not in a signal handler that interrupts it.
    #[inline]
    fn is_here(&self) -> bool {
        seat::is_at(std::ptr::from_ref(self).cast())
    }
}

/// What is to be told to other executors when all is done that several rings are for: each is woken once, not once a ring, and
/// none before, or their threads would take from this one, line by line, what it is still writing to.
#[derive(Default)]
pub struct Wakes<'a> {
    bell: Option<&'a Bell>,
    /// Where there are many rings: those that are still to be rung.
    batch: Option<Batch<'a>>,
}

/// Rings for so many members at a time.
const BATCH: usize = 32;

#[derive(Default)]
struct Batch<'a> {
    rings: [Option<(&'a Signal, Rings)>; BATCH],
    count: usize,
}

impl<'a> Wakes<'a> {
    /// Of many rings.
    #[must_use]
    pub fn of_many() -> Self {
        Self { batch: Some(Batch::default()), ..Self::default() }
    }

    /// Rings for a member of another executor, now or with the others.
    #[inline]
    fn ring(&mut self, signal: &'a Signal, rings: Rings) {
        let Some(batch) = &mut self.batch else { return self.ring_now(signal, rings) };
        batch.rings[batch.count] = Some((signal, rings));
        batch.count += 1;
        if batch.count == BATCH {
            self.ring_all();
        }
    }

    fn ring_now(&mut self, signal: &'a Signal, rings: Rings) {
        let bell = &*signal.bell;
        if signal.ring_far(rings)
            && let Some(before) = self.bell.replace(bell)
            && !std::ptr::eq(before, bell)
        {
            before.wake();
        }
    }

    fn ring_all(&mut self) {
        let Some(mut batch) = self.batch.take() else { return };
        for (signal, rings) in batch.rings.iter_mut().take(batch.count).filter_map(Option::take) {
            self.ring_now(signal, rings);
        }
        batch.count = 0;
        self.batch = Some(batch);
    }
}

impl Drop for Wakes<'_> {
    fn drop(&mut self) {
        self.ring_all();
        self.bell.into_iter().for_each(Bell::wake);
    }
}

/// Numbers that the executor's own thread rang for. Touched by no other thread; atomic all the same, because a callback
/// may be ended at any instruction, and so that what a thread does that only shares its thread-locals is no undefined behaviour.
struct Near {
    places: Box<[AtomicU32]>,
    head: AtomicUsize,
    tail: AtomicUsize,
}

impl Near {
    fn new() -> Self {
        let places = (0..MEMBERS_MAX).map(|_| AtomicU32::new(0)).collect();
        Self { places, head: AtomicUsize::new(0), tail: AtomicUsize::new(0) }
    }

    #[inline]
    fn is_empty(&self) -> bool {
        self.head.load(Ordering::Relaxed) == self.tail.load(Ordering::Relaxed)
    }

    /// False: there is no room.
    #[inline]
    fn push(&self, member: usize) -> bool {
        let tail = self.tail.load(Ordering::Relaxed);
        let Some(place) = self.places.get(tail) else { return self.close_up(member) };
        place.store(member as u32, Ordering::Relaxed);
        self.tail.store(tail + 1, Ordering::Release);
        true
    }

    /// The far end is reached: what is left moves to the beginning.
    #[cold]
    fn close_up(&self, member: usize) -> bool {
        let (head, tail) = (self.head.load(Ordering::Relaxed), self.tail.load(Ordering::Relaxed));
        if head == 0 {
            return false;
        }
        for (to, from) in (head..tail).enumerate() {
            let number = self.places[from].load(Ordering::Relaxed);
            self.places[to].store(number, Ordering::Relaxed);
        }
        self.head.store(0, Ordering::Relaxed);
        self.tail.store(tail - head, Ordering::Release);
        self.push(member)
    }

    /// The executor's loop only.
    #[inline]
    fn pop(&self) -> Option<usize> {
        let (head, tail) = (self.head.load(Ordering::Relaxed), self.tail.load(Ordering::Relaxed));
        let member = self.places.get(head).filter(|_| head != tail)?.load(Ordering::Relaxed) as usize;
        // From the beginning whenever it is empty: the same few words all the time.
        let (head, tail) = if head + 1 == tail { (0, 0) } else { (head + 1, tail) };
        self.head.store(head, Ordering::Relaxed);
        self.tail.store(tail, Ordering::Relaxed);
        Some(member)
    }
}

/// Why a member is to be looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Ring {
    /// Data arrived.
    Data = 1,
    /// Somebody asks for a service.
    Serve = 2,
    /// What its callback, or one of its tasks, waits for may be there.
    Wait = 4,
    /// A task has something to tell.
    Task = 8,
    /// Somebody charges it with a fault.
    Charge = 16,
    /// The emergency stop was raised.
    Emergency = 64,
}

/// Why a member was rung for since it was looked at last: several reasons at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rings(u32);

impl From<Ring> for Rings {
    fn from(why: Ring) -> Self {
        Self(why as u32)
    }
}

impl Rings {
    /// True when this is one of the reasons.
    #[must_use]
    pub const fn has(self, why: Ring) -> bool {
        self.0 & why as u32 != 0
    }

    /// True where somebody has something to tell that is no reason to enter a callback.
    #[must_use]
    pub const fn has_news(self) -> bool {
        self.0 & (Ring::Emergency as u32 | Ring::Task as u32 | Ring::Charge as u32) != 0
    }

    /// True without any.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// All but this one.
    #[must_use]
    pub const fn without(self, why: Ring) -> Self {
        Self(self.0 & !(why as u32))
    }

    /// Those of both.
    #[must_use]
    pub const fn and(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }
}

/// Rings for one member; shared by its ports. On a line of its own: writers on other processors fetch it ahead.
#[repr(align(64))]
pub struct Signal {
    bell: Arc<Bell>,
    member: AtomicUsize,
    /// Why the executor's own thread rang.
    near: AtomicU32,
    /// Why others did.
    far: AtomicU32,
    tasks: Crowd,
}

impl Signal {
    /// Of a member that has no number yet.
    #[must_use]
    pub fn new(bell: Arc<Bell>) -> Arc<Self> {
        let [near, far] = [AtomicU32::new(0), AtomicU32::new(0)];
        Arc::new(Self { bell, member: AtomicUsize::new(usize::MAX), near, far, tasks: Crowd::default() })
    }

    /// Sets the member's number.
    pub fn assign(&self, member: usize) {
        self.member.store(member, Ordering::Release);
    }

    /// Why it was rung for; the next ring queues the member again. On the executor's thread only.
    #[must_use]
    #[inline]
    pub fn take(&self) -> Rings {
        let near = self.near.load(Ordering::Relaxed);
        self.near.store(0, Ordering::Relaxed);
        let far = match self.far.load(Ordering::Relaxed) {
            0 => 0,
            _ => self.far.swap(0, Ordering::AcqRel),
        };
        Rings(near | far)
    }

    /// The member's number, on its executor's thread, as long as nobody at all is to be looked at there.
    #[must_use]
    #[inline]
    pub fn alone_here(&self) -> Option<usize> {
        let is_alone = self.bell.is_here() && self.bell.is_silent();
        is_alone.then(|| self.member.load(Ordering::Relaxed))
    }

    /// The member's tasks.
    pub const fn tasks(&self) -> &Crowd {
        &self.tasks
    }

    /// Has the member looked at.
    #[inline]
    pub fn ring(&self, why: Ring) {
        if why == Ring::Wait {
            self.tasks.wake_all();
        }
        self.ring_again(why.into());
    }

    /// Has the member looked at for reasons that were taken too early.
    #[inline]
    pub fn ring_again(&self, rings: Rings) {
        self.ring_among(rings, &mut Wakes::default());
    }

    /// Has the member looked at; its executor is woken with the others.
    #[inline]
    pub fn ring_among<'a>(&'a self, rings: Rings, wakes: &mut Wakes<'a>) {
        let member = self.member.load(Ordering::Acquire);
        if member == usize::MAX || rings.is_empty() {
            return;
        }
        if self.bell.is_here() && self.ring_near(member, rings) {
            return;
        }
        wakes.ring(self, rings);
    }

    /// True where its executor is to be woken.
    fn ring_far(&self, rings: Rings) -> bool {
        let is_new = self.far.fetch_or(rings.0, Ordering::AcqRel) == 0;
        if is_new {
            // Each member is in the queue at most once, so that it cannot be full.
            let _ = self.bell.far.push(self.member.load(Ordering::Relaxed));
        }
        is_new
    }

    /// Queued before it is said why: a callback that is ended in between leaves a look too many, not a member that is never
    /// queued again.
    #[inline]
    fn ring_near(&self, member: usize, rings: Rings) -> bool {
        let before = self.near.load(Ordering::Relaxed);
        if before == 0 && !self.bell.near.push(member) {
            return false;
        }
        self.near.store(before | rings.0, Ordering::Relaxed);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_values_ring_once_until_the_member_is_looked_at() {
        let bell = Bell::new();
        let signal = Signal::new(Arc::clone(&bell));
        signal.ring(Ring::Data);
        assert_eq!(bell.next_ready(), None, "without a number nobody is looked at");
        signal.assign(3);
        (0..5).for_each(|_| signal.ring(Ring::Data));
        signal.ring(Ring::Wait);
        assert_eq!((bell.next_ready(), bell.next_ready()), (Some(3), None));
        let rings = signal.take();
        assert!(rings.has(Ring::Data) && rings.has(Ring::Wait) && !rings.has(Ring::Serve));
        signal.ring_again(rings.without(Ring::Wait));
        assert_eq!(bell.next_ready(), Some(3));
        assert!(!signal.take().has(Ring::Wait) && signal.take().is_empty());
    }

    #[test]
    fn those_that_its_own_thread_rings_for_and_those_of_others_take_turns() {
        let bell = Bell::new();
        let signals: Vec<_> = (0..6).map(|_| Signal::new(Arc::clone(&bell))).collect();
        signals.iter().enumerate().for_each(|(number, signal)| signal.assign(number));
        signals[3..].iter().for_each(|signal| signal.ring(Ring::Data));
        bell.adopt();
        assert!(!seat::enter(&seat::Owner { slot: "", instance: 1 }));
        for _ in 0..3 {
            signals[..3].iter().for_each(|signal| signal.ring(Ring::Data));
        }
        let order: Vec<_> = std::iter::from_fn(|| bell.next_ready()).collect();
        assert_eq!(order, [3, 0, 4, 1, 5, 2]);
        assert!(signals.iter().all(|signal| signal.take().has(Ring::Data)));
        let interrupted = seat::interrupt(seat::Owner::NONE);
        signals[0].ring(Ring::Wait);
        seat::resume(interrupted);
        assert!(bell.near.is_empty(), "a handler may interrupt a ring");
        assert_eq!(bell.next_ready(), Some(0));
        bell.wait_until(None);
    }

    #[test]
    fn what_its_own_thread_rings_for_keeps_its_order_beyond_the_far_end() {
        let near = Near::new();
        let mut next = 0;
        for round in 0..3 * MEMBERS_MAX {
            assert!(near.push(round));
            if round >= 10 {
                assert_eq!(near.pop(), Some(next));
                next += 1;
            }
        }
        assert_eq!(std::iter::from_fn(|| near.pop()).count(), 10);
        assert!(near.is_empty() && near.pop().is_none());
        assert_eq!((0..=MEMBERS_MAX).take_while(|number| near.push(*number)).count(), MEMBERS_MAX);
    }
}
