//! Interleavings of rings and looks: none is lost, and there is no more than one look for each.

use std::sync::Arc;

use loom::model::Builder;
use loom::thread;
use loom_tests::real_bell::{Bell, Ring, Rings, Signal};

/// All interleavings with up to that many involuntary switches, instead of all.
fn bounded(switches: usize, model: impl Fn() + Send + Sync + 'static) {
    let mut builder = Builder::new();
    builder.preemption_bound = Some(switches);
    builder.check(model);
}

fn member(bell: &Arc<Bell>, number: usize) -> Arc<Signal> {
    let signal = Signal::new(Arc::clone(bell));
    signal.assign(number);
    signal
}

fn beside(signal: &Arc<Signal>, why: Ring) -> thread::JoinHandle<()> {
    let signal = Arc::clone(signal);
    thread::spawn(move || signal.ring(why))
}

/// The executor's loop, until each member was rung for as it must be; how often each was looked at. A ring that is lost is a
/// deadlock.
fn look(bell: &Bell, signals: &[Arc<Signal>], all: impl Fn(&[Rings]) -> bool) -> Vec<u32> {
    let (mut seen, mut looks) = (vec![Rings::default(); signals.len()], vec![0; signals.len()]);
    loop {
        while let Some(number) = bell.next_ready() {
            seen[number] = seen[number].and(signals[number].take());
            looks[number] += 1;
        }
        if all(&seen) {
            return looks;
        }
        bell.wait_until(None);
    }
}

#[test]
fn rings_of_two_threads_for_one_member_are_all_seen() {
    bounded(3, || {
        let bell = Bell::new();
        let signals = [member(&bell, 0)];
        bell.adopt();
        let others = [beside(&signals[0], Ring::Serve), beside(&signals[0], Ring::Wait)];
        let looks = look(&bell, &signals, |seen| seen[0].has(Ring::Serve) && seen[0].has(Ring::Wait));
        assert!(looks[0] <= 2, "at most once for each ring");
        others.into_iter().for_each(|other| other.join().unwrap());
        assert!(bell.next_ready().is_none() && signals[0].take().is_empty());
    });
}

#[test]
fn a_ring_of_its_own_thread_beside_one_of_another_is_seen() {
    bounded(3, || {
        let bell = Bell::new();
        let signals = [member(&bell, 0)];
        bell.adopt();
        let other = beside(&signals[0], Ring::Wait);
        signals[0].ring(Ring::Data);
        signals[0].ring(Ring::Serve);
        let all = |seen: &[Rings]| [Ring::Data, Ring::Serve, Ring::Wait].iter().all(|why| seen[0].has(*why));
        let looks = look(&bell, &signals, all);
        assert!(looks[0] <= 2, "once for its own thread, once for the other");
        other.join().unwrap();
        // Whoever was seen before it was queued is looked at once more, for nothing.
        while bell.next_ready().is_some() {}
        assert!(signals[0].take().is_empty());
    });
}

#[test]
fn two_members_are_both_looked_at_and_what_was_taken_too_early_comes_again() {
    bounded(2, || {
        let bell = Bell::new();
        let signals = [member(&bell, 0), member(&bell, 1)];
        bell.adopt();
        let others = [beside(&signals[0], Ring::Wait), beside(&signals[1], Ring::Serve)];
        signals[1].ring(Ring::Data);
        // Its callback waits: what is not for the wait is looked at afterwards.
        let early = signals[1].take();
        signals[1].ring_again(early.without(Ring::Wait));
        look(&bell, &signals, |seen| seen[0].has(Ring::Wait) && seen[1].has(Ring::Serve) && seen[1].has(Ring::Data));
        others.into_iter().for_each(|other| other.join().unwrap());
        assert!(signals.iter().all(|signal| signal.take().is_empty()));
    });
}
