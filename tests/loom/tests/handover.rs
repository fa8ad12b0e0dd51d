//! All interleavings of a hand-over: what is passed is taken whole, once, and nobody waits for ever.

use loom::cell::UnsafeCell;
use loom::sync::Arc;
use loom::thread;
use loom_tests::relay::Relay;
use loom_tests::wake::Waker;

/// What a thread leaves behind: written without any order of its own before it is passed.
struct Executor {
    cycles: UnsafeCell<u64>,
}

#[allow(unsafe_code, reason = "what is tested is that nobody else touches it")]
// SAFETY: the relay orders the accesses, which is what is tested; the checker reports those that are not ordered.
unsafe impl Sync for Executor {}
#[allow(unsafe_code, reason = "as above")]
// SAFETY: as above.
unsafe impl Send for Executor {}

fn executor() -> *mut Executor {
    Box::into_raw(Box::new(Executor { cycles: UnsafeCell::new(0) }))
}

#[allow(unsafe_code, reason = "a thread that runs the executor")]
fn run(executor: *mut Executor) {
    // SAFETY: whoever holds the address runs the executor alone; the checker sees whether it does.
    unsafe { (*executor).cycles.with_mut(|cycles| *cycles += 1) };
}

#[allow(unsafe_code, reason = "as above")]
fn end(executor: *mut Executor, cycles: u64) {
    // SAFETY: as above; this is the last use.
    let executor = unsafe { Box::from_raw(executor) };
    // SAFETY: nobody else has it any more.
    executor.cycles.with(|found| assert_eq!(unsafe { *found }, cycles));
}

struct Passed(*mut Executor);
#[allow(unsafe_code, reason = "an address on its way to a thread")]
// SAFETY: used by the thread that it is given to only.
unsafe impl Send for Passed {}

#[test]
fn what_a_lost_thread_passes_is_seen_whole() {
    loom::model(|| {
        let relay = Arc::new(Relay::<Executor, 1>::default());
        let reserve = thread::spawn({
            let relay = Arc::clone(&relay);
            move || {
                let taken = relay.take();
                run(taken);
                Passed(taken)
            }
        });
        let own = executor();
        run(own);
        assert!(relay.pass(own));
        end(reserve.join().unwrap().0, 2);
    });
}

#[test]
fn two_lost_threads_are_taken_over_by_two() {
    // Three threads beside the first: all interleavings with up to two involuntary switches, instead of all.
    let mut bounded = loom::model::Builder::new();
    bounded.preemption_bound = Some(2);
    bounded.check(|| {
        let relay = Arc::new(Relay::<Executor, 2>::default());
        let reserve = |relay: &Arc<Relay<Executor, 2>>| {
            let relay = Arc::clone(relay);
            thread::spawn(move || Passed(relay.take()))
        };
        let lost = thread::spawn({
            let relay = Arc::clone(&relay);
            move || assert!(relay.pass(executor()))
        });
        let first = reserve(&relay);
        assert!(relay.pass(executor()));
        let second = Passed(relay.take());
        lost.join().unwrap();
        let first = first.join().unwrap();
        assert_ne!(first.0, second.0);
        end(first.0, 0);
        end(second.0, 0);
    });
}

#[test]
fn more_than_there_are_places_is_refused_and_not_lost() {
    loom::model(|| {
        let relay = Relay::<Executor, 1>::default();
        let (first, second) = (executor(), executor());
        assert!(relay.pass(first));
        assert!(!relay.pass(second));
        assert_eq!(relay.take(), first);
        end(first, 0);
        end(second, 0);
    });
}

#[test]
fn a_wake_up_is_never_lost() {
    loom::model(|| {
        let waker = Arc::new(Waker::default());
        let other = thread::spawn({
            let waker = Arc::clone(&waker);
            move || waker.wake()
        });
        waker.wait_until(None);
        other.join().unwrap();
    });
}
