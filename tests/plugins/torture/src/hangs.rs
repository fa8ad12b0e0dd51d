//! Callbacks that do not return.

use std::hint::{black_box, spin_loop};
use std::sync::Mutex;
use std::time::Duration;

torture! {
    /// Spins: the program counter stays in the component's own code.
    InfiniteLoop => || loop {
        spin_loop();
    };

    /// Allocates and frees for ever: the program counter is in the allocator, now and then with its lock held.
    AllocationLoop => || loop {
        drop(black_box(vec![1u8; black_box(4096)]));
    };

    /// Waits for a lock that it holds itself.
    OwnDeadlock => || {
        let lock = Mutex::new(0u8);
        let held = lock.lock();
        let second = lock.lock();
        let _ = black_box((held.is_ok(), second.is_ok()));
    };

    /// Sleeps, whoever wakes it.
    SleepForever => || loop {
        std::thread::sleep(Duration::from_secs(3600));
    };

    /// Reads from a pipe into which nobody writes.
    BlockingRead => blocking_read;
}

fn blocking_read() {
    let mut ends = [0; 2];
    let mut byte = 0u8;
    // SAFETY: the array has room for two descriptors, the buffer for the one byte that is asked for.
    unsafe {
        libc::pipe2(ends.as_mut_ptr(), libc::O_CLOEXEC);
        while libc::read(ends[0], (&raw mut byte).cast(), 1) < 0 {}
    }
}
