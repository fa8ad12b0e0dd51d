//! Threads that a component starts: what goes wrong there is its fault too.

use super::memory::{overflow, read};

torture! {
    /// Reads the null page on a thread of its own.
    NullReadOnThread => || start(|| _ = std::hint::black_box(read(16)));

    /// Panics on a thread of its own.
    PanicOnThread => || start(|| panic!("torture on a thread"));

    /// Exhausts the stack of a thread of its own.
    StackOverflowOnThread => || start(|| _ = std::hint::black_box(overflow(1)));

    /// Aborts on a thread of its own.
    AbortOnThread => || start(|| std::process::abort());
}

fn start(body: fn()) {
    // Nobody waits for it: the component goes on.
    drop(std::thread::spawn(body));
}
