//! What a handler of a fatal signal saw, and where the program counter was.
//!
//! It is written once, where it lies: each copy of it takes a tenth of the way from the handler to the replacement.
#![allow(unsafe_code, reason = "address of unsafe: a place that a signal handler writes to")]

use std::cell::{Cell, UnsafeCell};

use super::text::Owner;
use super::{arch, leaf, text};
use crate::model::fault::TrapEvidence;
use crate::model::limits::CALLERS;

/// What the handler saw.
#[derive(Clone, Copy, Debug)]
pub struct Trap {
    /// Signal, address, registers.
    pub evidence: TrapEvidence,
    /// Where the program counter was.
    pub site: Site,
    /// The access hit the guard page below the fiber's stack.
    pub stack_overflow: bool,
    /// The component called `exit` or one of its kin.
    pub exited: bool,
    /// The component, or a runtime of its own, called `abort`.
    pub asked: bool,
    /// The callback did not return in time.
    pub hang: bool,
    /// The thread was given up; a reserve thread runs the executor now.
    pub thread_lost: bool,
    /// When it happened: of a hang, when its time was over; else when the handler was entered.
    pub at_ns: u64,
    /// When the handler was entered.
    pub seen_ns: u64,
}

impl Trap {
    /// One of which nothing more is known.
    #[must_use]
    pub const fn new(evidence: TrapEvidence, at_ns: u64) -> Self {
        let site = Site::Elsewhere;
        Self {
            evidence,
            site,
            stack_overflow: false,
            exited: false,
            asked: false,
            hang: false,
            thread_lost: false,
            at_ns,
            seen_ns: at_ns,
        }
    }
}

/// Where the program counter was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// In a plugin's own text, or nowhere after a wild jump out of it.
    Plugin,
    /// In a function of the C library that holds no lock, called by a plugin.
    Leaf,
    /// In the daemon's text, or in such a function called by it: a plugin passed a bad pointer.
    Daemon,
    /// Anywhere else: a lock may be held.
    Elsewhere,
}

impl Site {
    /// Of an access to `address` at `pc`, in a function that returns to `caller`, if it has no frame.
    pub(super) fn of(address: usize, pc: usize, caller: usize) -> Self {
        match text::owner(pc) {
            Some(Owner::Plugin) => return Self::Plugin,
            Some(Owner::Daemon) => return Self::Daemon,
            _ => {}
        }
        let nowhere = pc == address;
        if !nowhere && !leaf::holds(pc) {
            return Self::Elsewhere;
        }
        match text::owner(caller) {
            Some(Owner::Plugin) if nowhere => Self::Plugin,
            Some(Owner::Plugin) => Self::Leaf,
            Some(Owner::Daemon) => Self::Daemon,
            _ => Self::Elsewhere,
        }
    }
}

/// What a signal and its frame tell at once.
pub(super) struct Sight {
    pub(super) signal: i32,
    pub(super) code: i32,
    pub(super) address: usize,
    pub(super) at_ns: u64,
    pub(super) asked: bool,
    pub(super) exited: bool,
}

impl Sight {
    /// Writes it there; nothing more is known yet.
    #[inline(always)]
    pub(super) fn tell(&self, trap: &mut Trap, context: &libc::ucontext_t) {
        let (pc, sp) = arch::position(context);
        let evidence = &mut trap.evidence;
        (evidence.signal, evidence.code) = (self.signal, self.code);
        (evidence.address, evidence.pc, evidence.sp) = (self.address as u64, pc as u64, sp as u64);
        evidence.callers = [0; CALLERS];
        evidence.registers = arch::registers(context);
        (trap.site, trap.stack_overflow, trap.hang, trap.thread_lost) = (Site::Elsewhere, false, false, false);
        (trap.exited, trap.asked) = (self.exited, self.asked);
        (trap.at_ns, trap.seen_ns) = (self.at_ns, self.at_ns);
    }

    #[cold]
    #[inline(never)]
    pub(super) fn trap(&self, context: &libc::ucontext_t) -> Trap {
        let mut trap = Trap::new(TrapEvidence::new(0, 0, 0), 0);
        self.tell(&mut trap, context);
        trap
    }
}

/// Where the one trap of a fiber is written down.
pub(super) struct Seen {
    is_filled: Cell<bool>,
    trap: UnsafeCell<Trap>,
}

impl Seen {
    pub(super) const fn new() -> Self {
        let trap = Trap::new(TrapEvidence::new(0, 0, 0), 0);
        Self { is_filled: Cell::new(false), trap: UnsafeCell::new(trap) }
    }

    /// Has the trap written there; what is there already stays.
    #[inline(always)]
    pub(super) fn fill(&self, write: impl FnOnce(&mut Trap)) {
        if !self.is_filled.replace(true) {
            // SAFETY: filled once, by the thread that runs the fiber, and lent to nobody before: see `get`. A trap in `write`
            // itself does not come back here.
            write(unsafe { &mut *self.trap.get() });
        }
    }

    /// What was written there.
    pub(super) fn get(&self) -> Option<&Trap> {
        // SAFETY: it is written no more.
        self.is_filled.get().then(|| unsafe { &*self.trap.get() })
    }
}
