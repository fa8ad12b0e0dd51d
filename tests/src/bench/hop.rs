//! From a write to the reader: on one executor, between two, and to a hundred readers.

use std::time::{Duration, Instant};

use super::limits;
use super::stats::Samples;
use super::wire::{Bench, on};
use crate::profiles::connection_of;

/// Rounds of system and limit, in turns.
const ROUNDS: usize = 5;
/// Values between two readings of the clock: a hop is shorter than the clock's own cost.
const BATCH: &str = "500";
/// Idle members beside those that pass values on, so that what an executor does once in a while is divided by many hops.
const IDLE: usize = 62;
/// Readers of one output.
const READERS: usize = 100;
/// Longest time that a system runs that measured nothing yet.
const PATIENCE: Duration = Duration::from_secs(20);
/// Where the figures go.
const FILE: (&str, &str, &str) = ("file", "string", "@/figures");

/// What is passed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// 64 bytes.
    Small,
    /// 1 MiB.
    Large,
}

impl Payload {
    /// `64 B`, `1 MiB`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Small => "64 B",
            Self::Large => "1 MiB",
        }
    }

    const fn class(self) -> &'static str {
        match self {
            Self::Small => "HopSmall",
            Self::Large => "HopLarge",
        }
    }
}

/// What of a hop is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// From the write to the first instruction of the reader's callback.
    First,
    /// From one callback to the next: the write and the way, the read and the loan of what is written next.
    Turn,
}

/// Nanoseconds a hop between two slots of one executor, as the mean of many, and an indirect call with a copy of 64 bytes.
#[must_use]
pub fn same(payload: Payload, part: Part, sched: &str, run: Duration) -> (Samples, Samples) {
    let first = ("first", "bool", if part == Part::First { "true" } else { "false" });
    let leader = [("leads", "bool", "true"), ("batch", "int", BATCH), first, FILE];
    let follower = [("batch", "int", BATCH), first];
    let mut slots = vec![on("one", "ping", payload.class(), &leader), on("one", "pong", payload.class(), &follower)];
    slots.extend((0..IDLE).map(|number| on("one", &format!("idle{number}"), "Idler", &[])));
    in_turns(run, || ring(sched, &slots), copies)
}

/// Nanoseconds of each hop between two executors, each so long after the last one, and of a bare futex wake between two
/// threads.
#[must_use]
pub fn cross(payload: Payload, pause: Duration, sched: &str, run: Duration) -> (Samples, Samples) {
    let micros = pause.as_micros().to_string();
    let pauses = ("pause_us", "int", micros.as_str());
    let slots = [
        on("one", "ping", payload.class(), &[("leads", "bool", "true"), pauses, FILE]),
        on("other", "pong", payload.class(), &[pauses]),
    ];
    let rounds = if pause.is_zero() { 5_000 } else { 1_000 };
    let wakes = || limits::wake(rounds, pause);
    in_turns(run, || ring(sched, &slots), wakes)
}

/// Nanoseconds of a question and its answer, waited for, between two slots of one executor, as the mean of many, and an indirect
/// call with a copy of 64 bytes.
#[must_use]
pub fn query_same(sched: &str, run: Duration) -> (Samples, Samples) {
    in_turns(run, || asking(sched, "one", "false"), copies)
}

/// Nanoseconds of a question and its answer, waited for, between two executors, and of two bare futex wakes, one after the
/// other, between two threads.
#[must_use]
pub fn query_cross(sched: &str, run: Duration) -> (Samples, Samples) {
    let two_wakes = || limits::wake(10_000, Duration::ZERO).chunks_exact(2).map(|pair| pair.iter().sum()).collect();
    in_turns(run, || asking(sched, "other", "true"), two_wakes)
}

fn asking(sched: &str, executor: &str, single: &str) -> Bench {
    // The server is started first, so that it is stopped last.
    let callee = on(executor, "callee", "Callee", &[]);
    let caller = on("one", "caller", "Caller", &[("batch", "int", BATCH), ("single", "bool", single), FILE]);
    Bench::start(sched, &[callee, caller], &[&connection_of("service", "caller.ask -> callee.asked", "")])
}

fn ring(sched: &str, slots: &[String]) -> Bench {
    Bench::start(sched, slots, &["ping.said -> pong.heard", "pong.said -> ping.heard"])
}

/// Nanoseconds a reader that a write to a hundred takes, and a copy of 64 bytes for each.
#[must_use]
pub fn fan_out(executor: &str, sched: &str, run: Duration) -> (Samples, Samples) {
    let readers = READERS.to_string();
    let mut slots = vec![on("one", "caster", "Caster", &[("readers", "int", &readers), FILE])];
    let ear = |number| {
        let answers = if number + 1 == READERS { "true" } else { "false" };
        on(executor, &format!("ear{number}"), "Ear", &[("answers", "bool", answers)])
    };
    slots.extend((0..READERS).map(ear));
    let mut connections: Vec<_> = (0..READERS).map(|number| format!("caster.said -> ear{number}.heard")).collect();
    connections.push(format!("ear{}.said -> caster.heard", READERS - 1));
    let connections: Vec<&str> = connections.iter().map(String::as_str).collect();
    in_turns(run, || Bench::start(sched, &slots, &connections), copies)
}

/// A thousand figures of an indirect call with a copy of 64 bytes.
fn copies() -> Vec<u64> {
    const TIMES: u64 = 1_000;
    let figure = |_| {
        let began = Instant::now();
        limits::copy(TIMES);
        began.elapsed().as_nanos() as u64 / TIMES
    };
    (0..1_000).map(figure).collect()
}

fn in_turns(run: Duration, system: impl Fn() -> Bench, limit: impl Fn() -> Vec<u64>) -> (Samples, Samples) {
    let (mut own, mut raw) = (Samples::default(), Samples::default());
    for _ in 0..ROUNDS {
        let mut long = run / ROUNDS as u32;
        // Longer where it came to nothing, for a bounded time: `n` says how much was measured.
        while !system().finish(long, &mut own) && long < PATIENCE {
            long *= 2;
        }
        limit().into_iter().for_each(|figure| raw.add(figure));
    }
    (own, raw)
}
