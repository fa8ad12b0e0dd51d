//! `sys::seat` for the checker: which executor's thread this is.

use std::cell::Cell;

loom::thread_local! {
    static BELL: Cell<*const ()> = Cell::new(std::ptr::null());
}

/// This thread is the executor's with that bell, and in a callback.
pub fn sit_at(bell: *const ()) {
    BELL.with(|at| at.set(bell));
}

/// True on that thread.
#[must_use]
pub fn is_at(bell: *const ()) -> bool {
    BELL.with(|at| std::ptr::eq(at.get(), bell))
}
