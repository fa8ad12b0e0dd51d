//! What plugins see as the C library where it could end the daemon or take its signals: the executable comes first in
//! symbol resolution, so that these functions are ours (`build.rs` exports them).
//!
//! Called by the daemon itself they do what they always did. Called by plugin code they have no effect on what containment
//! rests on, or are a fault of the caller: `leave` and `replace` the end of the process, `send` signals sent, `signals`
//! and `waits` handlers and masks, `threads` threads, `descriptors` those that the daemon opened (`opens`).
#![allow(unsafe_code, reason = "address of unsafe: the C library's own functions behind ours")]

use std::cell::Cell;
use std::ffi::CStr;
use std::marker::PhantomData;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicPtr, Ordering};

use super::{arch, foreign, trap};

/// The daemon's descriptors.
pub mod descriptors;

/// Handlers of plugins.
pub mod handlers;

/// The end of the process.
pub mod leave;

/// Limits and filters of the whole process.
pub mod limits;

/// Descriptors that are made.
pub mod opens;

/// Another program in the process's place.
pub mod replace;

/// Signals that are sent.
pub mod send;

/// Handlers, masks, signal stacks.
pub mod signals;

/// Threads that plugins start.
pub mod threads;

/// Masks of calls that wait.
pub mod waits;

pub(super) use send::{is_fatal, is_self};
pub(super) use signals::{is_ours, unblock_ours};

/// Who calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Caller {
    /// The daemon, or a child process of a plugin, which may do what it likes.
    Daemon,
    /// A plugin that is being loaded: what would end the process does.
    Loader,
    /// A callback.
    Fiber,
    /// A thread that a plugin started.
    Thread,
    /// A plugin's own signal handler, on any thread.
    Handler,
}

thread_local! {
    static LOADS: Cell<bool> = const { Cell::new(false) };
}

/// Runs what calls a plugin's code on a thread of the daemon: its constructors, its tables.
pub fn load<T>(body: impl FnOnce() -> T) -> T {
    LOADS.set(true);
    let result = body();
    LOADS.set(false);
    result
}

static PROCESS: AtomicI32 = AtomicI32::new(0);
static FORKED: AtomicBool = AtomicBool::new(false);
static ENDING: AtomicBool = AtomicBool::new(false);

/// The process is about to end by a signal: whoever calls from now on does it for that.
pub(super) fn stand_down() {
    ENDING.store(true, Ordering::Release);
}

static TABLES: [Reals; 9] = [
    descriptors::REALS,
    leave::REALS,
    limits::REALS,
    opens::REALS,
    replace::REALS,
    send::REALS,
    signals::REALS,
    threads::REALS,
    waits::REALS,
];

/// Looks the C library's functions up and makes harmless what would end the process by default; once in a process.
pub fn install() {
    if PROCESS.swap(own_process(), Ordering::AcqRel) != 0 {
        return;
    }
    TABLES.iter().copied().flatten().for_each(|real| real.resolve());
    descriptors::own_streams();
    // SAFETY: the function stores a flag, which any child may do.
    unsafe { libc::pthread_atfork(None, None, Some(note_fork)) };
    signals::quiet();
}

extern "C" fn note_fork() {
    FORKED.store(true, Ordering::Release);
}

/// True in a copy of the daemon that a plugin's `fork` made. Whatever it does, it does to itself.
#[must_use]
#[inline]
pub fn is_copy() -> bool {
    FORKED.load(Ordering::Acquire)
}

/// A copy that comes back from plugin code ends here: two daemons would drive one robot.
#[inline]
pub(super) fn end_copy() {
    if is_copy() {
        // SAFETY: takes no memory, and does not return.
        unsafe { arch::system_call(libc::SYS_exit_group, [0; 6]) };
    }
}

fn own_process() -> i32 {
    // SAFETY: takes no memory.
    unsafe { libc::getpid() }
}

/// Whose code calls on this thread.
pub(super) fn caller() -> Caller {
    let guest = if handlers::is_here() {
        Caller::Handler
    } else if foreign::is_here() || trap::is_stray() {
        Caller::Thread
    } else if trap::on_fiber() {
        Caller::Fiber
    } else if LOADS.get() {
        Caller::Loader
    } else {
        return Caller::Daemon;
    };
    if is_child() || ENDING.load(Ordering::Acquire) { Caller::Daemon } else { guest }
}

/// True in any child of the daemon: one that shares our memory (`vfork`) has only its number of its own.
fn is_child() -> bool {
    let process = PROCESS.load(Ordering::Acquire);
    is_copy() || (process != 0 && process != own_process())
}

/// A function of the C library behind one of ours.
struct Real<F> {
    name: &'static CStr,
    found: AtomicPtr<libc::c_void>,
    kind: PhantomData<F>,
}

/// Looked up at start: `dlsym` is not for signal handlers.
trait Resolve: Sync {
    fn resolve(&self);
}

type Reals = &'static [&'static dyn Resolve];

// SAFETY: the only field that changes is atomic; `F` is a function pointer, of which there is none in here.
unsafe impl<F> Sync for Real<F> {}

impl<F> Resolve for Real<F> {
    fn resolve(&self) {
        // SAFETY: the name is a C string; what is returned is only kept here.
        let found = unsafe { libc::dlsym(libc::RTLD_NEXT, self.name.as_ptr()) };
        self.found.store(found, Ordering::Release);
    }
}

impl<F: Copy> Real<F> {
    /// Not yet looked up.
    ///
    /// # Safety
    /// `F` must be the type of a pointer to the C library's function of that name.
    const unsafe fn new(name: &'static CStr) -> Self {
        assert!(size_of::<F>() == size_of::<*mut libc::c_void>(), "a pointer to a function");
        Self { name, found: AtomicPtr::new(std::ptr::null_mut()), kind: PhantomData }
    }

    /// The next definition behind ours; `None`: this C library has none.
    fn get(&self) -> Option<F> {
        if self.found.load(Ordering::Acquire).is_null() {
            self.resolve();
        }
        let found = self.found.load(Ordering::Acquire);
        // SAFETY: both are pointers of one size, and `new` was promised that this one is of type `F`.
        (!found.is_null()).then(|| unsafe { std::mem::transmute_copy(&found) })
    }
}

/// What a function returns that this C library has not.
fn missing() -> i32 {
    // SAFETY: the address of this thread's `errno`.
    unsafe { *libc::__errno_location() = libc::ENOSYS };
    -1
}
