//! `sys::crowd` for the checker: nobody has tasks.

/// Wakers of a slot's tasks.
#[derive(Debug, Default)]
pub struct Crowd {}

impl Crowd {
    /// Wakes every task.
    pub const fn wake_all(&self) {}
}
