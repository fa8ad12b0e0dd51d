//! Random interleavings of the communication patterns against a model, a small number of them.
//! `scripts/interleavings` runs ten million steps and more.

use std::time::{SystemTime, UNIX_EPOCH};

use tests::sim::history::run;

/// What a run of that length sees surely: a model that sees nothing proves nothing.
const SEEN: [&str; 34] = [
    "activations told of",
    "answers",
    "asked again",
    "at once answered",
    "at once kept for later",
    "at once refused",
    "at once refused by the lane",
    "at once within another",
    "at once, disturbed",
    "at once, gave way",
    "cancelled",
    "cycles",
    "cycles begun",
    "disconnected",
    "events fetched",
    "firings handled",
    "messages pulled",
    "messages taken",
    "no data",
    "not activated",
    "passive",
    "provider gone",
    "provider replaced",
    "provider stopped",
    "set aside by a panic",
    "set aside by a trap",
    "set aside with a note",
    "set aside, waiting",
    "times at rest",
    "timeouts",
    "unanswered",
    "updates waited for",
    "values handled",
    "values taken",
];

#[test]
fn nothing_is_lost_or_doubled_and_nobody_waits_for_ever() {
    let seed = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    // Seeds that stay, and others each time.
    for seed in [1, seed] {
        let report = run(100_000, seed);
        assert!(report.failure.is_none(), "{}", report.text());
        let unseen: Vec<_> = SEEN.iter().filter(|what| !report.counts.contains_key(*what)).collect();
        assert!(unseen.is_empty(), "never: {unseen:?} in {}", report.text());
    }
}

#[test]
fn on_real_threads_every_question_has_its_end() {
    let crowd = tests::crowd::run(std::time::Duration::from_secs(4));
    assert!(crowd.problems.is_empty(), "{crowd:#?}");
    assert!(crowd.answered > 100 && crowd.heard > 0 && crowd.faults > 0, "{crowd:#?}");
}
