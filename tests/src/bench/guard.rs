//! What a guarded call costs: a closure on a fiber against the same closure by a bare indirect call.

use std::hint::black_box;
use std::time::Instant;

use framework_daemon::sys::fiber::{Fiber, NEVER};

use super::stats::Samples;

/// Calls in one sample: a single one is shorter than the clock's own cost.
const BATCH: u32 = 1000;

/// Nanoseconds a call, on a fiber and bare.
///
/// # Panics
/// When there is no address space for a stack.
#[must_use]
pub fn measure(samples: usize) -> (Samples, Samples) {
    let (mut guarded, mut bare) = (Samples::default(), Samples::default());
    let mut fiber = Fiber::new(64 << 10).expect("address space for one stack");
    let mut count = 0u64;
    let mut closure = || count = black_box(count + 1);
    for _ in 0..samples {
        let began = Instant::now();
        for _ in 0..BATCH {
            black_box(fiber.run(NEVER, black_box(&mut closure)));
        }
        guarded.add(began.elapsed().as_nanos() as u64 / u64::from(BATCH));
        let began = Instant::now();
        for _ in 0..BATCH {
            let call: &mut dyn FnMut() = black_box(&mut closure);
            call();
        }
        bare.add(began.elapsed().as_nanos() as u64 / u64::from(BATCH));
    }
    (guarded, bare)
}
