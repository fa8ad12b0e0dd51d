//! Random histories of faults and orders on random dependency graphs, against a naive model that shares no line with what it
//! judges.
//!
//! `drawn (a small system) -> life (one history of it) -> naive (what must be)`. Real are the rules of a slot
//! (`model::ladder`), the graph, diagnosis, decision and the fault manager's memory of how all slots are; played are the
//! executors, so that starts and recoveries fail by lot.

/// A small system, drawn by lot.
mod drawn;

/// One history.
mod life;

/// What must be.
mod naive;

use std::collections::BTreeMap;
use std::fmt::Write;
use std::thread;

use life::Life;

/// How often something was seen.
pub type Counts = BTreeMap<&'static str, u64>;

/// What many histories came to.
#[derive(Debug, Default)]
pub struct Report {
    /// How often something was seen.
    pub counts: Counts,
    /// The first history that went wrong: its seed, what is wrong, and the history.
    pub failure: Option<String>,
}

impl Report {
    /// In words.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (what, count) in &self.counts {
            let _ = writeln!(text, "{what:<24} {count}");
        }
        text + self.failure.as_deref().unwrap_or("nothing went wrong")
    }
}

/// Plays that many histories, the first with that seed, each other one with the next.
#[must_use]
pub fn run(histories: u64, seed: u64) -> Report {
    let mut report = Report::default();
    for number in 0..histories {
        let seed = seed.wrapping_add(number);
        // One in sixteen is lived twice: equal input gives equal output.
        let again = number.is_multiple_of(16).then(|| Life::lived(seed));
        match Life::lived(seed) {
            Ok(life) if again.is_some_and(|again| again.as_ref() != Ok(&life)) => {
                report.failure = Some(format!("history {seed} came out differently the second time"));
            }
            Ok(life) => life.counts.iter().for_each(|(what, count)| *report.counts.entry(what).or_default() += count),
            Err(wrong) => report.failure = Some(format!("history {seed}: {wrong}")),
        }
        *report.counts.entry("histories").or_default() += 1;
        if report.failure.is_some() {
            break;
        }
    }
    report
}

/// As [`run`], on that many threads.
///
/// # Panics
/// When one of them does.
#[must_use]
pub fn run_on(threads: u64, histories: u64, seed: u64) -> Report {
    let share = histories.div_ceil(threads.max(1));
    let parts = (0..threads).map(|part| thread::spawn(move || run(share, seed.wrapping_add(part * share))));
    let parts: Vec<_> = parts.collect();
    let mut whole = Report::default();
    for part in parts {
        let part = part.join().expect("a history does not panic");
        part.counts.iter().for_each(|(what, count)| *whole.counts.entry(what).or_default() += count);
        whole.failure = whole.failure.or(part.failure);
    }
    whole
}
