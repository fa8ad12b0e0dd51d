//! A value that is read all the time and changed now and then: the connections of a port.
//!
//! Bounded hazard pointers. There are a few versions, one of them current; who reads pins the version that it reads, who
//! changes fills one that nobody pins and makes it current. The owner (the callbacks of the port's slot, one thread at a
//! time) keeps its pin after it has read: while nothing is changed, its next read is two loads. Readers never wait, an edit
//! waits for no reader, and nothing is allocated or dropped in here: what an edit finds in its place is handed back.
//!
//! `arc-swap` was there before: two atomic exchanges a read, an allocation an edit. Counting the owner's entries instead of
//! keeping its pin was the alternative: two more atomic exchanges a read.
#![allow(unsafe_code, reason = "address of unsafe: versions that are filled while others are read")]

use std::cell::UnsafeCell;

use crate::sys::futex::{AtomicU32, Ordering, fence};

/// Readers at a time: the owner, and threads beside it.
const PINS: usize = 4;
/// One is current, each pin holds at most one other, one is free.
const VERSIONS: usize = PINS + 2;
/// No version.
const NONE: u32 = u32::MAX;
/// How often a place or the right to edit is asked for, with a pause after each time.
const ATTEMPTS: usize = 1_000;

/// Somebody else is at it, and stays at it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;

/// Versions that an edit took out: the caller drops or recycles them.
pub type Stale<T> = [Option<T>; VERSIONS];

/// One value, exchanged as a whole.
pub struct Exchange<T> {
    versions: [UnsafeCell<Option<T>>; VERSIONS],
    current: AtomicU32,
    /// The first is the owner's.
    pins: [AtomicU32; PINS],
    editing: AtomicU32,
}

// SAFETY: a version is written by one editor at a time, while it is neither current nor pinned; references to it go to
// several threads, and it may be dropped by another one than made it.
unsafe impl<T: Send + Sync> Send for Exchange<T> {}
// SAFETY: as above.
unsafe impl<T: Send + Sync> Sync for Exchange<T> {}

impl<T> Exchange<T> {
    /// With its first version.
    pub fn new(value: T) -> Self {
        let mut versions = [const { UnsafeCell::new(None) }; VERSIONS];
        *versions[0].get_mut() = Some(value);
        let pins = std::array::from_fn(|_| AtomicU32::new(NONE));
        Self { versions, current: AtomicU32::new(0), pins, editing: AtomicU32::new(0) }
    }

    /// Shows the owner the present version. It may be changed meanwhile; what is shown stays as it is.
    ///
    /// # Safety
    /// One thread at a time, and not from within `look`.
    #[inline]
    pub unsafe fn own<R>(&self, look: impl FnOnce(&T) -> R) -> R {
        let mut index = self.current.load(Ordering::Acquire);
        if self.pins[0].load(Ordering::Relaxed) != index {
            index = self.pin(&self.pins[0]);
        }
        // SAFETY: the pin is held until the owner moves it, which is after `look`.
        unsafe { self.show(index, look) }
    }

    /// Shows any other thread the present version. `look` must touch no memory that may be missing: a thread that ends in
    /// it keeps its pin.
    ///
    /// # Errors
    /// Too many do that at the same time.
    pub fn visit<R>(&self, look: impl FnOnce(&T) -> R) -> Result<R, Busy> {
        let pin =
            patiently(|| self.pins[1..].iter().find(|pin| claim(pin, NONE, self.current.load(Ordering::Acquire))))?;
        let index = self.pin(pin);
        // SAFETY: pinned until the line after it.
        let result = unsafe { self.show(index, look) };
        pin.store(NONE, Ordering::Release);
        Ok(result)
    }

    /// Replaces the value by one that `make` makes of it, and hands back what nobody reads any more. `make` touches no memory
    /// that may be missing: a thread that ends in it keeps the right to edit.
    ///
    /// # Errors
    /// Somebody else edits all the time.
    pub fn edit(&self, make: impl FnOnce(&T) -> T) -> Result<Stale<T>, Busy> {
        patiently(|| claim(&self.editing, 0, 1).then_some(()))?;
        let before = self.current.load(Ordering::Relaxed);
        // SAFETY: only an editor changes which version is current, and this thread is the only one.
        let fresh = unsafe { self.show(before, make) };
        let stale = self.install(before, fresh);
        self.editing.store(0, Ordering::Release);
        Ok(stale)
    }

    fn install(&self, before: u32, fresh: T) -> Stale<T> {
        let (mut fresh, mut stale) = (Some(fresh), [const { None }; VERSIONS]);
        fence(Ordering::SeqCst);
        for index in (0..VERSIONS as u32).filter(|index| *index != before) {
            if self.is_pinned(index) {
                continue;
            }
            // SAFETY: neither current nor pinned. Whoever pins it from now on finds that it is not current, or finds it
            // current, which it becomes after it was filled.
            let place = unsafe { &mut *self.versions[index as usize].get() };
            stale[index as usize] = place.take();
            if fresh.is_some() {
                *place = fresh.take();
                self.current.store(index, Ordering::Release);
            }
        }
        fence(Ordering::SeqCst);
        // What was current until now goes, too, unless it is read.
        if !self.is_pinned(before) {
            // SAFETY: as above.
            stale[before as usize] = unsafe { &mut *self.versions[before as usize].get() }.take();
        }
        stale
    }

    fn is_pinned(&self, index: u32) -> bool {
        self.pins.iter().any(|pin| pin.load(Ordering::Acquire) == index)
    }

    /// Pins the present version.
    fn pin(&self, pin: &AtomicU32) -> u32 {
        loop {
            let index = self.current.load(Ordering::Acquire);
            pin.store(index, Ordering::Release);
            // With the fences in `install`: whoever makes another version current after this sees the pin, and whoever did
            // before is seen by the load.
            fence(Ordering::SeqCst);
            if self.current.load(Ordering::Acquire) == index {
                return index;
            }
        }
    }

    /// # Safety
    /// That version must be pinned, or nobody may edit meanwhile.
    #[inline]
    unsafe fn show<R>(&self, index: u32, look: impl FnOnce(&T) -> R) -> R {
        // SAFETY: the caller's promise; versions are numbered from 0.
        let version = unsafe { &*self.versions[index as usize].get() };
        look(version.as_ref().expect("the current version is filled"))
    }
}

fn claim(word: &AtomicU32, free: u32, taken: u32) -> bool {
    word.compare_exchange(free, taken, Ordering::AcqRel, Ordering::Relaxed).is_ok()
}

/// Asks again and again, with pauses in which others may finish.
pub(super) fn patiently<R>(mut ask: impl FnMut() -> Option<R>) -> Result<R, Busy> {
    for _ in 0..ATTEMPTS {
        if let Some(answer) = ask() {
            return Ok(answer);
        }
        crate::sys::futex::pause();
    }
    Err(Busy)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[allow(unsafe_code, reason = "the test is the owner")]
    fn own(exchange: &Exchange<u64>) -> u64 {
        // SAFETY: one thread of each test reads as the owner.
        unsafe { exchange.own(|value| *value) }
    }

    #[test]
    fn what_is_read_stays_while_it_is_changed_and_comes_back_afterwards() {
        let exchange = Exchange::new(1);
        assert_eq!(own(&exchange), 1);
        let stale = exchange.edit(|now| now + 1).unwrap();
        assert!(stale.iter().all(Option::is_none), "the owner keeps its pin");
        assert_eq!(exchange.visit(|value| *value), Ok(2));
        assert_eq!(own(&exchange), 2);
        let stale = exchange.edit(|now| now + 1).unwrap();
        assert_eq!(stale.into_iter().flatten().collect::<Vec<_>>(), [1]);
    }

    #[test]
    fn more_visitors_than_pins_are_told_so_and_edits_go_on_around_them() {
        let exchange = Exchange::new(0);
        let deepest = exchange.visit(|_| {
            exchange.visit(|_| {
                exchange.visit(|_| {
                    for value in 1..10 {
                        exchange.edit(|_| value).unwrap();
                    }
                    exchange.visit(|value| *value)
                })
            })
        });
        assert_eq!(deepest, Ok(Ok(Ok(Err(Busy)))));
        assert_eq!(exchange.visit(|value| *value), Ok(9));
    }

    #[test]
    fn an_owner_visitors_and_editors_at_full_speed_see_whole_values_that_never_go_back() {
        let exchange = Arc::new(Exchange::new([0u64; 8]));
        let editors: Vec<_> = (0..2)
            .map(|_| {
                let exchange = Arc::clone(&exchange);
                std::thread::spawn(move || {
                    for _ in 0..20_000 {
                        let _ = exchange.edit(|now| now.map(|word| word + 1));
                    }
                })
            })
            .collect();
        let mut last = 0;
        while editors.iter().any(|editor| !editor.is_finished()) {
            #[allow(unsafe_code, reason = "the test is the owner")]
            // SAFETY: this thread only.
            let own = unsafe { exchange.own(|value| *value) };
            let seen = exchange.visit(|value| *value).unwrap();
            for value in [own, seen] {
                assert!(value.iter().all(|word| *word == value[0]) && value[0] >= last);
                last = value[0];
            }
        }
        editors.into_iter().for_each(|editor| editor.join().unwrap());
    }
}
