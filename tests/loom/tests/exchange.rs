//! Interleavings of readers and editors of an exchanged value: it is whole, never edited while it is read, and never goes back.

use loom::cell::UnsafeCell;
use loom::model::Builder;
use loom::sync::Arc;
use loom::thread;
use loom_tests::exchange::{Exchange, Stale};

/// A version. The checker reports whoever reads it while an editor uses its memory again.
struct Version(UnsafeCell<u64>);

#[allow(unsafe_code, reason = "what is tested is that nobody else touches it")]
// SAFETY: the exchange orders the accesses, which is what is tested.
unsafe impl Sync for Version {}
#[allow(unsafe_code, reason = "as above")]
// SAFETY: as above.
unsafe impl Send for Version {}

fn version(number: u64) -> Version {
    Version(UnsafeCell::new(number))
}

#[allow(unsafe_code, reason = "a reader")]
fn seen(version: &Version) -> u64 {
    // SAFETY: a reader; the checker sees whether somebody writes.
    version.0.with(|number| unsafe { *number })
}

#[allow(unsafe_code, reason = "the owner")]
fn own(exchange: &Exchange<Version>) -> u64 {
    // SAFETY: one thread of each model reads as the owner.
    unsafe { exchange.own(seen) }
}

/// What is handed back is the editor's alone: it is written over.
#[allow(unsafe_code, reason = "an editor")]
fn spoil(stale: Stale<Version>) {
    for version in stale.into_iter().flatten() {
        // SAFETY: nobody reads it any more, which is what is tested.
        version.0.with_mut(|number| unsafe { *number = u64::MAX });
    }
}

fn edit(exchange: &Exchange<Version>) {
    spoil(exchange.edit(|now| version(seen(now) + 1)).expect("nobody edits for ever"));
}

/// All interleavings with up to that many involuntary switches, instead of all.
fn bounded(switches: usize, model: impl Fn() + Send + Sync + 'static) {
    let mut builder = Builder::new();
    builder.preemption_bound = Some(switches);
    builder.check(model);
}

#[test]
fn the_owner_sees_whole_versions_that_never_go_back() {
    bounded(3, || {
        let exchange = Arc::new(Exchange::new(version(0)));
        let editor = thread::spawn({
            let exchange = Arc::clone(&exchange);
            move || {
                edit(&exchange);
                edit(&exchange);
            }
        });
        let (first, second) = (own(&exchange), own(&exchange));
        assert!(first <= second && second <= 2);
        editor.join().unwrap();
        assert_eq!(own(&exchange), 2);
    });
}

#[test]
fn a_visitor_beside_the_owner_sees_whole_versions() {
    bounded(2, || {
        let exchange = Arc::new(Exchange::new(version(0)));
        let editor = thread::spawn({
            let exchange = Arc::clone(&exchange);
            move || edit(&exchange)
        });
        let visitor = thread::spawn({
            let exchange = Arc::clone(&exchange);
            move || {
                let seen = exchange.visit(seen).expect("there is a place");
                assert!(seen <= 1);
            }
        });
        assert!(own(&exchange) <= 1);
        editor.join().unwrap();
        visitor.join().unwrap();
    });
}

#[test]
fn two_editors_lose_no_edit() {
    bounded(3, || {
        let exchange = Arc::new(Exchange::new(version(0)));
        let editor = thread::spawn({
            let exchange = Arc::clone(&exchange);
            move || edit(&exchange)
        });
        edit(&exchange);
        let seen_between = own(&exchange);
        assert!((1..=2).contains(&seen_between));
        editor.join().unwrap();
        assert_eq!(own(&exchange), 2);
    });
}
