//! The way into a member's handlers from within the callback of another member of the same executor, for questions that are
//! answered at once ([`crate::port::pattern::direct`]).
//!
//! A lane has a fiber of its own, so that a handler which traps or hangs is ended as any other: whoever asked goes on, and has
//! as much time then as after any wait. What a handler leaves behind, other than its answer, the
//! executor sees to: the callback that asked waits, and the member takes up what happened in its lane as if it had
//! entered the handler itself (`Member::take_up_aside`).
//!
//! An executor that enters the handler itself after the callback waits was the alternative: it takes three times as long.
#![allow(unsafe_code, reason = "address of unsafe: what the executor's thread only touches, behind a shared reference")]

use std::cell::UnsafeCell;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};

use component_sdk::abi::calls::ServeArgs;

use super::callback::Fibers;
use super::strand::Frame;
use super::unit::Unit;
use crate::model::limits::{TIME_AT_ONCE_NS, TURNS_AT_ONCE};
use crate::port::pattern::direct::{self, Served};
use crate::sys::bell::Signal;
use crate::sys::fiber::{Fiber, Outer};
use crate::sys::seat::{self, Owner};

/// What an executor and the lanes of its members tell each other. Written by its thread only; atomic, because lanes are shared.
#[derive(Debug, Default)]
pub struct Aside {
    /// The member whose callback may ask others at once, and one more; 0: none.
    entered: AtomicUsize,
    /// How long it may take, from one wait to the next, in nanoseconds.
    limit_ns: AtomicU64,
    /// How often it did ask, as long as it is not others' turn.
    turns: AtomicU32,
    /// When it asked first; 0: it has not yet.
    since_ns: AtomicU64,
    /// How long others ran on its time, in nanoseconds.
    away_ns: AtomicU64,
    /// Lanes that the executor has to look at, counted.
    news: AtomicU32,
}

impl Aside {
    /// The callback of that member is entered: it may ask others at once.
    #[inline]
    pub(super) fn enter(&self, member: usize, limit_ns: u64) {
        self.entered.store(member + 1, Ordering::Relaxed);
        self.limit_ns.store(limit_ns, Ordering::Relaxed);
        self.turns.store(0, Ordering::Relaxed);
        self.since_ns.store(0, Ordering::Relaxed);
    }

    /// No callback is, or it may not ask. Where it failed nobody asked how long others ran on its time: that is not to be
    /// taken for the time of the next one's.
    #[inline]
    pub(super) fn leave(&self) {
        self.entered.store(0, Ordering::Relaxed);
        self.away_ns.store(0, Ordering::Relaxed);
    }

    /// How long others ran on the time of the callback, since this was asked last.
    #[inline]
    pub(super) fn take_away_ns(&self) -> u64 {
        let away_ns = self.away_ns.load(Ordering::Relaxed);
        if away_ns != 0 {
            self.away_ns.store(0, Ordering::Relaxed);
        }
        away_ns
    }

    /// True while lanes are to be looked at: what callbacks left to be asked about is of those that ran there.
    #[inline]
    pub(super) fn has_news(&self) -> bool {
        self.news.load(Ordering::Relaxed) != 0
    }

    /// All lanes are looked at now.
    pub(super) fn take_news(&self) -> bool {
        let news = self.news.load(Ordering::Relaxed);
        self.news.store(0, Ordering::Relaxed);
        news != 0
    }

    /// True where that member may be asked: by another one, which has not asked so often or so long that it is others' turn.
    #[inline]
    fn lets(&self, member: usize) -> bool {
        let entered = self.entered.load(Ordering::Relaxed);
        entered != 0 && entered != member + 1 && self.turns.load(Ordering::Relaxed) < TURNS_AT_ONCE
    }

    fn limit_ns(&self) -> u64 {
        self.limit_ns.load(Ordering::Relaxed)
    }

    /// From now on a callback runs from within another one, which may take that long; how it was before.
    fn go_in(&self, limit_ns: u64) -> Before {
        let before = Before { limit_ns: self.limit_ns(), away_ns: self.away_ns.load(Ordering::Relaxed) };
        self.limit_ns.store(limit_ns, Ordering::Relaxed);
        before
    }

    /// It ran from the one moment to the other; whoever ran on its own time ran meanwhile.
    fn come_out(&self, before: &Before, (began_ns, ended_ns): (u64, u64)) {
        self.limit_ns.store(before.limit_ns, Ordering::Relaxed);
        self.away_ns.store(before.away_ns + ended_ns.saturating_sub(began_ns), Ordering::Relaxed);
        let since_ns = match self.since_ns.load(Ordering::Relaxed) {
            0 => began_ns,
            since_ns => since_ns.min(began_ns),
        };
        self.since_ns.store(since_ns, Ordering::Relaxed);
        // Through the inbox others would have had their turn after each question.
        let is_long = ended_ns.saturating_sub(since_ns) >= TIME_AT_ONCE_NS;
        let turns = if is_long { TURNS_AT_ONCE } else { self.turns.load(Ordering::Relaxed) + 1 };
        self.turns.store(turns, Ordering::Relaxed);
    }

    /// One lane more is to be looked at; returns which one it is: those within others come first.
    fn add_news(&self) -> u32 {
        let news = self.news.load(Ordering::Relaxed) + 1;
        self.news.store(news, Ordering::Relaxed);
        news
    }
}

/// What is put back when a callback has come out of another one.
struct Before {
    limit_ns: u64,
    away_ns: u64,
}

/// A member's lane.
pub struct Lane {
    signal: Arc<Signal>,
    /// The member is at rest.
    is_open: AtomicBool,
    room: UnsafeCell<Room>,
}

// SAFETY: the room is touched by the thread of the member's executor only: `serve` and `is_open` ask for it first, and all
// others need the member or the executor's fibers, which only that thread has. What is in it may move with its executor.
unsafe impl Send for Lane {}
// SAFETY: as above.
unsafe impl Sync for Lane {}

#[derive(Default)]
struct Room {
    aside: Arc<Aside>,
    owner: Option<Owner>,
    hang_ns: u64,
    /// With a frame for handlers of the owner.
    fiber: Option<Box<Fiber<Frame>>>,
    /// What ran there is to be looked at, in that order; 0: nothing.
    news: u32,
}

impl Lane {
    /// Of the member that is rung by that signal; closed.
    #[must_use]
    pub fn new(signal: Arc<Signal>) -> Arc<Self> {
        Arc::new(Self { signal, is_open: AtomicBool::new(false), room: UnsafeCell::default() })
    }

    /// # Safety
    /// On the thread of the member's executor only, and not while what was returned before is still used.
    #[allow(clippy::mut_from_ref, reason = "one thread only, one use at a time: the caller's promise")]
    unsafe fn room(&self) -> &mut Room {
        // SAFETY: the caller's promise.
        unsafe { &mut *self.room.get() }
    }

    /// From now on handlers of that instance are entered here, while its member is at rest. True: a fiber was taken for that.
    pub(super) fn open(&self, unit: &Unit, aside: &Arc<Aside>, fibers: &mut Fibers) -> bool {
        // SAFETY: with the executor's fibers at hand this is its thread, and nobody is in the lane: only callbacks enter it.
        let room = unsafe { self.room() };
        let is_anew = room.owner != Some(unit.owner);
        let takes = is_anew && room.furnish(unit, fibers);
        if is_anew {
            room.aside = Arc::clone(aside);
        }
        let is_whole = room.news == 0 && room.fiber.is_some();
        self.is_open.store(is_whole, Ordering::Relaxed);
        takes
    }

    /// Nobody enters it.
    #[inline]
    pub(super) fn close(&self) {
        self.is_open.store(false, Ordering::Relaxed);
    }

    /// What ran there is to be looked at; those with smaller numbers come first.
    pub(super) fn news(&self) -> Option<u32> {
        // SAFETY: asked by the member's executor, while no callback runs.
        Some(unsafe { self.room() }.news).filter(|news| *news != 0)
    }

    /// Takes out the fiber that ran there, or waits.
    pub(super) fn take_out(&self) -> Option<Box<Fiber<Frame>>> {
        // SAFETY: as of `news`.
        let room = unsafe { self.room() };
        room.news = 0;
        // Furnished anew before it is opened again.
        room.owner = None;
        room.fiber.take()
    }

    /// The member leaves: its fiber goes back.
    pub(super) fn clear(&self, fibers: &mut Fibers) {
        self.close();
        // SAFETY: as of `open`.
        let room = unsafe { self.room() };
        room.owner = None;
        room.fiber.take().into_iter().for_each(|fiber| fibers.take_back_idle(fiber));
    }
}

impl Room {
    /// A fiber of the right size, where there is room for a stack, with a frame for that instance; true: it was taken now.
    fn furnish(&mut self, unit: &Unit, fibers: &mut Fibers) -> bool {
        let stack_bytes = unit.limits.stack_bytes;
        if let Some(fiber) = self.fiber.take_if(|fiber| fiber.stack_bytes() != stack_bytes) {
            fibers.take_back_idle(fiber);
        }
        let takes = self.fiber.is_none();
        if takes {
            self.fiber = fibers.lend(stack_bytes).ok();
        }
        if let Some(fiber) = &mut self.fiber {
            fiber.furnish(|place| *place = Some(Frame::serving(unit.instance.entry(), &unit.limits)));
        }
        (self.owner, self.hang_ns) = (Some(unit.owner), unit.limits.hang_ns);
        takes
    }

    /// True where the handler that was entered there returned, and left nothing to be asked about.
    fn is_clean(&self) -> bool {
        let idle = self.fiber.as_ref().filter(|fiber| fiber.is_idle());
        idle.and_then(|fiber| fiber.errand()).is_some_and(Frame::is_done) && !seat::has_notes()
    }
}

impl direct::Lane for Lane {
    #[inline]
    fn is_open(&self) -> bool {
        let lets = |member: usize| {
            // SAFETY: the signal says that this is the executor's thread; an open lane is used by nobody.
            self.is_open.load(Ordering::Relaxed) && unsafe { self.room() }.aside.lets(member)
        };
        self.signal.alone_here().is_some_and(lets) && !seat::has_notes()
    }

    /// Called where it is open.
    fn serve(&self, args: ServeArgs) -> Served {
        // SAFETY: asked where it is open, on the executor's thread. Whatever the handler asks for, this lane is closed meanwhile.
        let room = unsafe { self.room() };
        let Some(outer) = Outer::here(room.aside.limit_ns()) else { return Served::Not };
        let (Some(owner), Some(fiber)) = (&room.owner, &mut room.fiber) else { return Served::Not };
        self.close();
        let (client, before) = (seat::owner(), room.aside.go_in(room.hang_ns));
        seat::enter(owner);
        fiber.furnish(|place| place.iter_mut().for_each(|frame| frame.take_up(args)));
        let times = fiber.begin_within(&outer, room.hang_ns);
        seat::enter(&client);
        room.aside.come_out(&before, times);
        if room.is_clean() {
            self.is_open.store(true, Ordering::Relaxed);
            return Served::Done;
        }
        room.news = room.aside.add_news();
        Served::Aside
    }
}
