//! Threads that carry executors. An executor's loop runs on a stack of its own, so that it need not stay with its thread:
//! when a callback's thread must be given up, a reserve thread continues the loop where it waits for that callback.
//!
//! The alternative, a new thread that builds the loop's state anew, would have to guess what the compiler kept in registers
//! when the thread was lost; here the loop itself only sees a callback that ended. What it costs: after each callback the
//! thread may be another one, so the loop must not keep the address of a thread-local across it.
//!
//! Reserve threads are shared by all executors with the same schedule, because a thread keeps its schedule for life.
#![allow(unsafe_code, reason = "address of unsafe: a reserve thread takes a fiber over")]

use std::cell::RefCell;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use corosensei::Coroutine;
use corosensei::stack::DefaultStack;
use crossbeam_channel::{Receiver, TryRecvError, bounded};

use super::pulse::Pulse;
use super::relay::Relay;
use super::trap::Armed;
use super::wake::Waker;
use super::{arch, thread, watchdog};
use crate::model::limits::{RESERVE_THREADS, SCHEDULE_STACK_BYTES};
use crate::model::schedule::Schedule;

/// What an executor's fibers share: what the watchdog reads, and who takes over.
#[derive(Clone, Default)]
pub struct Lease {
    pub(super) pulse: Arc<Pulse>,
    pub(super) relay: Option<&'static Relay<Armed>>,
}

thread_local! {
    static LEASE: RefCell<Lease> = RefCell::new(Lease::default());
}

/// The lease of the executor whose thread calls this; one without a reserve elsewhere.
#[must_use]
#[inline(never)]
pub fn lease() -> Lease {
    LEASE.with_borrow(Clone::clone)
}

/// A thread that carries something, as whoever started it sees it.
#[derive(Debug)]
pub struct Carried(Receiver<()>);

impl Carried {
    /// True when what it carried is over.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.0.try_recv() == Err(TryRecvError::Disconnected)
    }

    /// Waits until it is.
    pub fn wait(&self) {
        // Nothing is ever sent.
        let _ = self.0.recv();
    }
}

/// Starts a thread that carries `body`, with a reserve, and ends when that is over: without destructors of thread-locals, for
/// those of components would run here, outside of any callback, and after a trap meet half-changed state. What the system does not permit of `schedule` is passed to
/// `refused`, in words.
///
/// # Errors
/// When the system has no thread left.
pub fn spawn(
    name: &str,
    schedule: Schedule,
    refused: impl FnOnce(&str) + Send + 'static,
    body: impl FnOnce() + Send + 'static,
) -> std::io::Result<Carried> {
    let relay = reserve(&schedule)?;
    let stack = DefaultStack::new(SCHEDULE_STACK_BYTES)?;
    let (running, over) = bounded(0);
    let carry = move || {
        body();
        drop(running);
        arch::exit_thread()
    };
    thread::spawn_guarded(name, schedule, refused, move || {
        let lease = Lease { pulse: Arc::default(), relay: Some(relay) };
        lease.pulse.move_to(thread::id());
        watchdog::add(&lease.pulse);
        LEASE.set(lease);
        let mut executor = Coroutine::<(), (), ()>::with_stack(stack, move |_, ()| carry());
        executor.resume(());
    })?;
    Ok(Carried(over))
}

/// Reserve threads of one schedule.
struct Reserve {
    schedule: Schedule,
    relay: &'static Relay<Armed>,
    waiting: Arc<()>,
}

/// All reserves, and the thread that fills them up.
struct Keeper {
    reserves: Mutex<Vec<Reserve>>,
    waker: Waker,
}

static KEEPER: OnceLock<Keeper> = OnceLock::new();

/// The relay of that schedule, with reserve threads behind it.
fn reserve(schedule: &Schedule) -> std::io::Result<&'static Relay<Armed>> {
    let keeper = keeper()?;
    let mut reserves = keeper.reserves.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = reserves.iter().find(|reserve| reserve.schedule == *schedule) {
        return Ok(known.relay);
    }
    // One for each schedule that was ever used: handlers hold on to it.
    let relay: &'static Relay<Armed> = Box::leak(Box::default());
    let mut reserve = Reserve { schedule: schedule.clone(), relay, waiting: Arc::default() };
    reserve.fill()?;
    reserves.push(reserve);
    Ok(relay)
}

fn keeper() -> std::io::Result<&'static Keeper> {
    let mut first = false;
    let keeper = KEEPER.get_or_init(|| {
        first = true;
        Keeper { reserves: Mutex::default(), waker: Waker::default() }
    });
    if first {
        watchdog::start()?;
        thread::spawn("reserve-keeper", keep)?;
    }
    Ok(keeper)
}

/// Fills up what was taken. An ordinary thread: starting one takes a hundred microseconds, which no recovery waits for.
fn keep() {
    let Some(keeper) = KEEPER.get() else { return };
    loop {
        keeper.waker.wait_until(None);
        for reserve in keeper.reserves.lock().unwrap_or_else(PoisonError::into_inner).iter_mut() {
            if let Err(error) = reserve.fill() {
                tracing::error!(
                    "no thread can be started in reserve ({error}): the next that is given up stops its executor"
                );
            }
        }
    }
}

impl Reserve {
    fn fill(&mut self) -> std::io::Result<()> {
        while Arc::strong_count(&self.waiting) <= RESERVE_THREADS {
            let (relay, waiting) = (self.relay, Arc::clone(&self.waiting));
            thread::spawn_guarded("reserve", self.schedule.clone(), |_| {}, move || stand_by(relay, waiting))?;
        }
        Ok(())
    }
}

/// Waits until a thread is given up, then goes on in its place; what lies on this thread's own stack is not needed again.
fn stand_by(relay: &'static Relay<Armed>, waiting: Arc<()>) {
    let passed = relay.take();
    drop(waiting);
    if let Some(keeper) = KEEPER.get() {
        keeper.waker.wake();
    }
    // SAFETY: what is passed is a fiber of an executor, which lives as long as the executor's loop, which waits for it; the
    // thread that ran it has ended or is about to, and touches it no more.
    unsafe { (*passed).take_over() }
}
