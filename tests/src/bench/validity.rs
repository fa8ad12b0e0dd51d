//! What a check of a field costs: an object of sixteen numbers, each held to its range, against a bare load and two
//! comparisons for each.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use component_sdk::object::CommObject;
use framework_daemon::port::block::{Block, Sample};
use framework_daemon::port::check::{Checks, Verdict};
use framework_daemon::profile::plan::{Limit, Location, OnInvalid, Validity};

use super::stats::Samples;

/// Numbers in the object.
const FIELDS: usize = 16;
/// Objects in one sample: a single one is shorter than the clock's own cost.
const BATCH: u32 = 1_000;
const RANGE: (f64, f64) = (-1.0, 1.0);

type Object = [f64; FIELDS];

/// Nanoseconds an object: checked as a port checks it, and bare.
///
/// # Panics
/// When a valid value is not found to be.
#[must_use]
pub fn check(samples: usize) -> (Samples, Samples) {
    let rules: Vec<_> = (0..FIELDS).map(rule).collect();
    let checks = Checks::compile(&rules, Object::DESCRIPTOR).expect("each field is there");
    // Memory of a block is zero at first, which is valid.
    let sample: Sample = Arc::new(Block::new(Object::DESCRIPTOR));
    let bare: Object = [0.0; FIELDS];
    let (mut checked, mut limit) = (Samples::default(), Samples::default());
    for _ in 0..samples {
        checked.add(each(|now_ns| {
            let verdict = checks.judge_block("bench", black_box(&sample), now_ns);
            assert!(matches!(verdict, Verdict::Pass), "zero is within");
        }));
        limit.add(each(|_| {
            let (min, max) = black_box(RANGE);
            // One after the other, as a check does: not several at once, nor all or nothing.
            let within = |value: &f64| *value >= min && *value <= max && black_box(true);
            assert!(black_box(&bare).iter().all(within), "zero is within");
        }));
    }
    (checked, limit)
}

fn rule(place: usize) -> Validity {
    Validity {
        field: format!("[{place}]"),
        min: Some(Limit::Constant(RANGE.0)),
        max: Some(Limit::Constant(RANGE.1)),
        max_rate: None,
        delay: Duration::ZERO,
        on_invalid: OnInvalid::Drop,
        location: Location::default(),
    }
}

fn each(mut call: impl FnMut(u64)) -> u64 {
    let began = Instant::now();
    for number in 0..BATCH {
        call(u64::from(number));
    }
    began.elapsed().as_nanos() as u64 / u64::from(BATCH)
}
