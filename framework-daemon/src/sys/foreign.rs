//! Threads that plugins start. What would end the process there ends that thread, and is reported for the slot whose
//! callback started it; the slot is answered by its rules.
//!
//! The kernel thread is ended, not parked: robust locks come back, whoever joins it returns. Its stack stays, because others
//! may still borrow from it; only what lies far below where it began is given back.
#![allow(unsafe_code, reason = "address of unsafe: how a plugin's thread starts")]

use std::cell::Cell;
use std::io;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use crossbeam_channel::Receiver;
use crossbeam_queue::ArrayQueue;
use libc::c_void;

use super::seat::{self, Owner};
use super::thread::{self, SignalStack};
use super::trap::{self, Site, Trap};
use super::wake::Waker;
use super::{arch, clock, heap, shield, text};
use crate::model::fault::{Evidence, TrapEvidence};
use crate::model::limits::{FOREIGN_REPORTS, STACK_OVERFLOW_REACH_BYTES};

/// What happened on a plugin's thread.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// It trapped, or called what ends a process, and is no more.
    Trapped(Trap),
    /// It panicked.
    Panicked(Evidence),
    /// It ended after a panic.
    Ended,
}

/// What happened, where and when.
#[derive(Clone, Copy, Debug)]
pub struct Report {
    /// Who started the thread; [`Owner::NONE`]: a plugin, when it was loaded.
    pub owner: Owner,
    /// The function that the thread began with.
    pub start: usize,
    /// What happened.
    pub event: Event,
    /// When.
    pub at_ns: u64,
    /// The kernel's number of the thread.
    pub thread: i32,
}

impl Report {
    /// File name of the plugin whose code it was.
    #[must_use]
    pub fn plugin(&self) -> Option<&'static str> {
        let pc = if let Event::Trapped(trap) = &self.event { trap.evidence.pc as usize } else { 0 };
        text::plugin_of(pc).or_else(|| text::plugin_of(self.start))
    }
}

static LOST: AtomicU64 = AtomicU64::new(0);

/// Threads of plugins that were ended where they were; each leaves its stack behind.
#[must_use]
pub fn lost_threads() -> u64 {
    LOST.load(Ordering::Relaxed)
}

struct Post {
    reports: ArrayQueue<Report>,
    waker: Waker,
    lost: AtomicU64,
}

static POST: OnceLock<Post> = OnceLock::new();

thread_local! {
    // `const` and without destructor: the handler may read them at any moment.
    static HERE: Cell<Option<Here>> = const { Cell::new(None) };
    static PANICKED: Cell<bool> = const { Cell::new(false) };
    // With a destructor: touched by the thread's beginning and end only.
    static GUARD: Cell<Option<Guard>> = const { Cell::new(None) };
}

/// A thread that a plugin started.
#[derive(Clone, Copy, Default)]
struct Here {
    /// Lower end of its stack.
    low: usize,
    /// Where on its stack it began.
    top: usize,
    /// The function that it began with.
    start: usize,
}

/// What a thread holds until its last destructor has run. The first to register one is the last to be called.
struct Guard(#[allow(dead_code, reason = "held for the kernel")] SignalStack);

impl Drop for Guard {
    fn drop(&mut self) {
        if PANICKED.get() {
            report(Event::Ended, clock::now_ns());
        }
        // The daemon's again: it may take the signal stack away.
        HERE.set(None);
    }
}

/// True on a thread that a plugin started.
#[must_use]
pub fn is_here() -> bool {
    HERE.get().is_some()
}

/// What a new thread is to do, and for whom.
pub(super) struct Birth {
    owner: Owner,
    start: extern "C-unwind" fn(*mut c_void) -> *mut c_void,
    argument: *mut c_void,
}

impl Birth {
    /// Of a thread that the code of this one starts.
    pub(super) fn new(start: extern "C-unwind" fn(*mut c_void) -> *mut c_void, argument: *mut c_void) -> *mut Self {
        Box::into_raw(Box::new(Self { owner: seat::owner(), start, argument }))
    }

    /// The thread was not made.
    ///
    /// # Safety
    /// It must come from [`Self::new`] and be nobody else's.
    pub(super) unsafe fn forget(birth: *mut Self) {
        // SAFETY: as promised.
        drop(unsafe { Box::from_raw(birth) });
    }
}

/// Where a thread of the daemon begins.
pub(super) extern "C-unwind" fn begin_own(birth: *mut c_void) -> *mut c_void {
    // SAFETY: `pthread_create` passes what `Birth::new` made, to this thread only.
    let Birth { start, argument, .. } = *unsafe { Box::from_raw(birth.cast::<Birth>()) };
    GUARD.set(Some(Guard(SignalStack::untouched())));
    start(argument)
}

/// Where a plugin's thread begins. No destructor waits in this frame: the thread may end by `pthread_exit`.
pub(super) extern "C-unwind" fn begin(birth: *mut c_void) -> *mut c_void {
    // SAFETY: `pthread_create` passes what `Birth::new` made, to this thread only.
    let Birth { owner, start, argument } = *unsafe { Box::from_raw(birth.cast::<Birth>()) };
    heap::adopt_thread();
    GUARD.set(Some(Guard(SignalStack::untouched())));
    shield::unblock_ours();
    seat::adopt(owner);
    let top = (&raw const owner).addr();
    HERE.set(Some(Here { low: lower_end(), top, start: start as usize }));
    let value = start(argument);
    shield::end_copy();
    value
}

/// Lower end of this thread's stack, its guard left out.
fn lower_end() -> usize {
    // SAFETY: the attributes are filled before they are read, and destroyed once.
    unsafe {
        let mut attributes: libc::pthread_attr_t = std::mem::zeroed();
        if libc::pthread_getattr_np(libc::pthread_self(), &raw mut attributes) != 0 {
            return 0;
        }
        let (mut low, mut size) = (std::ptr::null_mut(), 0);
        libc::pthread_attr_getstack(&raw const attributes, &raw mut low, &raw mut size);
        libc::pthread_attr_destroy(&raw mut attributes);
        low.addr()
    }
}

impl Here {
    /// True for an address where an overflow of the stack would strike.
    fn is_near_end(&self, address: usize) -> bool {
        self.low != 0 && self.low.abs_diff(address) < STACK_OVERFLOW_REACH_BYTES
    }

    /// Gives back what an overflow filled; what lies near the beginning stays. Not below the frame that runs, where this
    /// is not the handler's stack.
    fn give_back(&self) {
        let frame = (&raw const self).addr();
        let kept = self.top.saturating_sub(KEPT_STACK_BYTES);
        let end =
            if (self.low..self.top).contains(&frame) { kept.min(frame - KEPT_STACK_BYTES.min(frame)) } else { kept };
        let (start, end) = (self.low.next_multiple_of(PAGE_BYTES), end / PAGE_BYTES * PAGE_BYTES);
        if self.low != 0 && start < end {
            // SAFETY: stack of this thread, which never runs again; nothing of it is unmapped.
            unsafe { libc::madvise(std::ptr::without_provenance_mut(start), end - start, libc::MADV_DONTNEED) };
        }
    }
}

/// How much of a dead thread's stack is left as it was.
const KEPT_STACK_BYTES: usize = 64 << 10;

/// At least the size of a page.
const PAGE_BYTES: usize = 64 << 10;

/// A trap on this thread. Returns where no plugin started it; else the thread ends here.
pub(super) fn struck(mut trap: Trap, context: &libc::ucontext_t) {
    let here = HERE.get().unwrap_or_default();
    if here.start == 0 && !trap::is_stray() {
        return;
    }
    let (address, pc, sp) = (trap.evidence.address as usize, trap.evidence.pc as usize, trap.evidence.sp as usize);
    // SAFETY: the stack of this thread is mapped between these.
    let caller = if (here.low..here.top).contains(&sp) { unsafe { arch::return_address(context) } } else { 0 };
    trap.site = Site::of(address, pc, caller);
    // SAFETY: as above; the handler runs beside it.
    trap.evidence.callers = unsafe { trap::callers(context, here.low..here.top) };
    trap.stack_overflow = trap.evidence.signal == libc::SIGSEGV && here.is_near_end(address) && here.is_near_end(sp);
    end(trap)
}

/// This thread called what ends a process: `exit` and its kin, or `abort`. It alone ends.
pub(super) fn leave(exited: bool) -> ! {
    let evidence = TrapEvidence::new(libc::SIGABRT, 0, 0);
    end(Trap { exited, asked: !exited, site: Site::Plugin, ..Trap::new(evidence, clock::now_ns()) })
}

fn end(trap: Trap) -> ! {
    LOST.fetch_add(1, Ordering::Relaxed);
    if trap.site == Site::Elsewhere {
        heap::abandon_thread();
    }
    report(Event::Trapped(trap), trap.at_ns);
    HERE.get().inspect(Here::give_back);
    arch::exit_thread()
}

/// A plugin's signal handler failed on this thread, whoever's it is.
pub(super) fn failed(owner: Owner, trap: Trap) {
    report_for(owner, Event::Trapped(trap), trap.at_ns);
}

/// A panic on this thread, which a plugin started.
pub fn panicked(evidence: Evidence) {
    PANICKED.set(true);
    report(Event::Panicked(evidence), clock::now_ns());
}

fn report(event: Event, at_ns: u64) {
    report_for(seat::owner(), event, at_ns);
}

fn report_for(owner: Owner, event: Event, at_ns: u64) {
    let Some(post) = POST.get() else { return };
    // SAFETY: takes no memory.
    let thread = unsafe { libc::gettid() };
    let start = HERE.get().map_or(0, |here| here.start);
    if post.reports.push(Report { owner, start, event, at_ns, thread }).is_err() {
        post.lost.fetch_add(1, Ordering::Relaxed);
    }
    post.waker.wake();
}

/// Passes reports on from now on.
///
/// # Errors
/// When the system has no thread left.
pub fn listen() -> io::Result<Receiver<Report>> {
    let post = POST.get_or_init(|| Post {
        reports: ArrayQueue::new(FOREIGN_REPORTS),
        waker: Waker::default(),
        lost: AtomicU64::new(0),
    });
    let (sender, receiver) = crossbeam_channel::unbounded();
    thread::spawn("foreign", move || {
        let mut held = Held::default();
        loop {
            post.waker.wait_until(held.deadline_ns());
            let mut ready: Vec<Report> =
                std::iter::from_fn(|| post.reports.pop()).filter_map(|report| held.sort(report)).collect();
            ready.extend(held.overdue(clock::now_ns()));
            if ready.into_iter().any(|report| sender.send(report).is_err()) {
                return;
            }
            let lost = post.lost.swap(0, Ordering::Relaxed);
            if lost > 0 {
                tracing::error!("{lost} faults on threads of plugins were not reported: they came too fast");
            }
        }
    })?;
    Ok(receiver)
}

/// How long a panic is held back where its thread neither ends nor traps: somebody caught it. Long, because on a busy machine a
/// thread may not run for a while between a panic and the trap that follows from it, and that would be two faults.
const PANIC_PATIENCE_NS: u64 = 1_000_000_000;

/// Panics whose threads have not ended yet: one that ends in a trap of its thread (a panic in a drop) is one fault, the
/// trap.
#[derive(Default)]
struct Held(Vec<Report>);

impl Held {
    /// What that report says is certain now.
    fn sort(&mut self, report: Report) -> Option<Report> {
        let before = self.0.iter().position(|held| held.thread == report.thread);
        match report.event {
            Event::Panicked(_) if before.is_none() => self.0.push(report),
            Event::Panicked(_) => {}
            Event::Ended => return before.map(|index| self.0.remove(index)),
            Event::Trapped(_) => {
                before.into_iter().for_each(|index| _ = self.0.remove(index));
                return Some(report);
            }
        }
        None
    }

    fn deadline_ns(&self) -> Option<u64> {
        self.0.first().map(|held| held.at_ns + PANIC_PATIENCE_NS)
    }

    fn overdue(&mut self, now_ns: u64) -> Vec<Report> {
        self.0.extract_if(.., |held| held.at_ns + PANIC_PATIENCE_NS <= now_ns).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::fault::ShortText;

    const PANICKED: Event = Event::Panicked(Evidence::Text { message: ShortText::EMPTY });

    fn report(event: Event, thread: i32, at_ns: u64) -> Report {
        Report { owner: Owner::NONE, start: 0, event, at_ns, thread }
    }

    fn trapped() -> Event {
        let evidence = TrapEvidence::new(libc::SIGABRT, 0, 0);
        Event::Trapped(Trap::new(evidence, 0))
    }

    #[test]
    fn a_panic_is_told_when_its_thread_has_ended() {
        let mut held = Held::default();
        assert!(held.sort(report(PANICKED, 1, 5)).is_none());
        assert!(held.sort(report(PANICKED, 1, 6)).is_none(), "a second one, while it unwinds");
        assert!(held.sort(report(Event::Ended, 2, 7)).is_none());
        assert_eq!(held.sort(report(Event::Ended, 1, 8)).map(|report| report.at_ns), Some(5));
        assert_eq!(held.deadline_ns(), None);
    }

    #[test]
    fn a_panic_that_ends_in_a_trap_is_one_fault() {
        let mut held = Held::default();
        assert!(held.sort(report(PANICKED, 1, 5)).is_none());
        assert!(held.sort(report(trapped(), 2, 6)).is_some());
        assert!(matches!(held.sort(report(trapped(), 1, 7)), Some(Report { event: Event::Trapped(_), .. })));
        assert!(held.overdue(u64::MAX).is_empty());
    }

    #[test]
    fn a_panic_that_somebody_caught_is_told_later() {
        let mut held = Held::default();
        assert!(held.sort(report(PANICKED, 1, 5)).is_none());
        let deadline = held.deadline_ns().unwrap();
        assert!(held.overdue(deadline - 1).is_empty());
        assert_eq!(held.overdue(deadline).len(), 1);
    }
}
