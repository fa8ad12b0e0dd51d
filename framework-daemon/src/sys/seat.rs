//! Whose code runs on this thread, and whether it left something to be asked about: one block of thread-local words,
//! because every callback sets them and every call of a component reads them.
//!
//! Never inlined: the thread may be another one after a callback, and nobody may keep the block's address.

use std::cell::Cell;

/// Whose code it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Owner {
    /// The slot's name.
    pub slot: &'static str,
    /// Number of the instance in it.
    pub instance: u64,
}

impl Owner {
    /// Nobody.
    pub const NONE: Self = Self { slot: "", instance: 0 };
}

/// What a callback may leave to be asked about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Note {
    /// It told something about itself: a panic, an error, a fault.
    Told = 1,
    /// A check found something in what it wrote.
    Found = 2,
    /// A fault was provoked in it.
    Injected = 8,
    /// It registered memory for its checkpoint.
    Region = 4,
    /// It started a task.
    Spawned = 16,
}

struct Seat {
    owner: Cell<Owner>,
    /// The instance whose callback runs; 0 where the code is that of a thread which a component started.
    entered: Cell<u64>,
    /// The bell of the executor whose thread this is.
    bell: Cell<*const ()>,
    /// What is entered is a task of the owner: `entered` is its own number.
    is_task: Cell<bool>,
    notes: Cell<u8>,
}

thread_local! {
    // `const` and without destructor: signal handlers may read it at any moment.
    static SEAT: Seat = const {
        Seat {
            owner: Cell::new(Owner::NONE),
            entered: Cell::new(0),
            bell: Cell::new(std::ptr::null()),
            is_task: Cell::new(false),
            notes: Cell::new(0),
        }
    };
}

/// A callback of that instance is entered on this thread; true: an earlier one left something that nobody asked about.
#[inline(never)]
pub fn enter(owner: &Owner) -> bool {
    SEAT.with(|seat| {
        seat.owner.set(*owner);
        seat.entered.set(owner.instance);
        seat.notes.get() != 0
    })
}

/// This thread is the executor's with that bell.
#[inline(never)]
pub fn sit_at(bell: *const ()) {
    SEAT.with(|seat| seat.bell.set(bell));
}

/// True on the thread of the executor with that bell, but for signal handlers that interrupt a callback.
#[must_use]
#[inline(never)]
pub fn is_at(bell: *const ()) -> bool {
    SEAT.with(|seat| std::ptr::eq(seat.bell.get(), bell) && seat.entered.get() != 0)
}

/// A task of that owner is entered on this thread, which runs nothing but tasks; its number is no instance's.
#[inline(never)]
pub fn enter_task(owner: Owner, number: u64) {
    SEAT.with(|seat| {
        seat.owner.set(owner);
        seat.entered.set(number);
        seat.is_task.set(true);
    });
}

/// A task that runs on this thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tasked {
    /// The instance whose it is.
    pub instance: u64,
    /// Its own number.
    pub number: u64,
}

/// The task that runs on this thread, if it is one.
#[must_use]
#[inline(never)]
pub fn task() -> Option<Tasked> {
    SEAT.with(|seat| {
        let tasked = Tasked { instance: seat.owner.get().instance, number: seat.entered.get() };
        Some(tasked).filter(|tasked| seat.is_task.get() && tasked.number != 0)
    })
}

/// Says whose code runs on this thread from now on, other than a callback: a thread's.
#[inline(never)]
pub fn adopt(owner: Owner) {
    SEAT.with(|seat| seat.owner.set(owner));
}

/// Who was interrupted.
#[derive(Clone, Copy, Debug)]
pub struct Interrupted(Owner, u64);

/// A signal handler of that owner interrupts whatever runs here: what it calls is no call of a callback.
#[inline(never)]
pub fn interrupt(owner: Owner) -> Interrupted {
    SEAT.with(|seat| Interrupted(seat.owner.replace(owner), seat.entered.replace(0)))
}

/// What was interrupted goes on.
#[inline(never)]
pub fn resume(interrupted: Interrupted) {
    SEAT.with(|seat| {
        seat.owner.set(interrupted.0);
        seat.entered.set(interrupted.1);
    });
}

/// Whose code runs, or last ran, on this thread.
#[must_use]
#[inline(never)]
pub fn owner() -> Owner {
    SEAT.with(|seat| seat.owner.get())
}

/// Number of the instance whose callback runs on this thread; 0 on a thread that a component started.
#[must_use]
#[inline(never)]
pub fn entered() -> u64 {
    SEAT.with(|seat| seat.entered.get())
}

/// Leaves a note; false: it is there already.
#[inline(never)]
pub fn leave(note: Note) -> bool {
    SEAT.with(|seat| {
        let notes = seat.notes.get();
        seat.notes.set(notes | note as u8);
        notes & note as u8 == 0
    })
}

/// True when anything was left.
#[must_use]
#[inline(never)]
pub fn has_notes() -> bool {
    SEAT.with(|seat| seat.notes.get() != 0)
}

/// True when that note was left.
#[must_use]
#[inline(never)]
pub fn is_left(note: Note) -> bool {
    SEAT.with(|seat| seat.notes.get() & note as u8 != 0)
}

/// Takes a note; false: it is not there.
#[inline(never)]
pub fn take(note: Note) -> bool {
    SEAT.with(|seat| {
        let notes = seat.notes.get();
        seat.notes.set(notes & !(note as u8));
        notes & note as u8 != 0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_is_left_once_and_taken_once() {
        assert!(!enter(&Owner { slot: "one", instance: 7 }) && !has_notes());
        assert!(leave(Note::Found) && !leave(Note::Found) && leave(Note::Told));
        assert!(enter(&Owner { slot: "two", instance: 8 }) && has_notes());
        assert!(take(Note::Found) && !take(Note::Found) && !take(Note::Region) && take(Note::Told));
        assert!(!has_notes());
        let interrupted = interrupt(Owner::NONE);
        assert_eq!((owner(), entered()), (Owner::NONE, 0));
        resume(interrupted);
        assert_eq!((owner().slot, entered()), ("two", 8));
        adopt(Owner::NONE);
        assert_eq!((owner(), entered()), (Owner::NONE, 8));
    }
}
