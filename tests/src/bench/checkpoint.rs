//! A checkpoint as executors make it: on a fiber, with its checksum, into the file that outlives the daemon; against a bare copy
//! of as many bytes, to two places in turn as well.

use std::hint::black_box;
use std::time::{Duration, Instant};

use framework_daemon::exec::checkpoint::{Checkpoint, Region};
use framework_daemon::exec::keep::Keep;
use framework_daemon::exec::member::Crew;

use super::guard;
use super::stats::Samples;

/// Size of the region in bytes.
pub const BYTES: usize = 64 << 10;

/// Nanoseconds each, in turns.
///
/// # Panics
/// When there is no room for the file, or the plugin of the basic components is not there.
#[must_use]
pub fn measure(samples: usize) -> (Samples, Samples) {
    let scratch = tempfile::TempDir::new().expect("a temporary directory");
    let keep = Keep::open(&scratch.path().join("checkpoints"), scratch.path(), false).expect("there is room");
    let mut checkpoint = Checkpoint::every(Duration::ZERO, "bench");
    checkpoint.keep_in(Some(keep));
    let mut crew = Crew::new(crossbeam_channel::bounded(1).0);
    let mut unit = guard::idle_unit(&mut crew.fibers);
    let region = vec![7_u8; BYTES];
    unit.register(Region { name: "bench", address: region.as_ptr().expose_provenance(), len: BYTES });
    checkpoint.furnish(&unit.regions, &[], unit.origin());
    let mut bare = [vec![0_u8; BYTES], vec![0_u8; BYTES]];
    let (mut own, mut limit) = (Samples::default(), Samples::default());
    for number in 0..samples {
        own.add(time(|| crew.back_up(&mut unit, &mut checkpoint).expect("the region is there")));
        limit.add(time(|| black_box(&mut bare[number % 2]).copy_from_slice(black_box(&region))));
    }
    assert!(checkpoint.whole_for(&unit.regions).is_some(), "the last copy is whole");
    (own, limit)
}

fn time(act: impl FnOnce()) -> u64 {
    let began = Instant::now();
    act();
    began.elapsed().as_nanos() as u64
}
