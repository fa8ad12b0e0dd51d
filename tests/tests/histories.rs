//! Random histories of faults on random dependency graphs, a small number of them. `scripts/histories` plays ten million.

use std::time::{SystemTime, UNIX_EPOCH};

use tests::histories::run;

/// What a run of that length sees surely: a model that sees nothing proves nothing.
const SEEN: [&str; 15] = [
    "clears",
    "consequences",
    "emergencies",
    "held",
    "histories",
    "lost events",
    "orders",
    "replacements",
    "resets",
    "roots",
    "starts",
    "starts that failed",
    "stops",
    "voters that agree again",
    "voters that stop others",
];

#[test]
fn nobody_runs_who_may_not_and_nobody_rests_who_could_run() {
    let seed = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    // Seeds that stay, and others each time.
    for seed in [1, seed] {
        let report = run(1_500, seed);
        assert!(report.failure.is_none(), "{}", report.text());
        let unseen: Vec<_> = SEEN.iter().filter(|what| !report.counts.contains_key(*what)).collect();
        assert!(unseen.is_empty(), "never: {unseen:?} in {}", report.text());
    }
}
