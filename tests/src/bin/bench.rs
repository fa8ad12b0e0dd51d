//! Runs benchmarks and prints one JSON object a line; see `scripts/bench`.

use std::io::Write;

use tests::bench::recovery::Load;
use tests::bench::{guard, recovery, stats};

const FAULTS: usize = 10_000;

fn main() -> std::io::Result<()> {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|asked| asked == name);
    // The bare panics are not to be told.
    std::panic::set_hook(Box::new(|_| {}));
    let mut out = std::io::stdout().lock();
    if is_wanted("guard_cost") {
        let (mut own, mut limit) = guard::measure(1000);
        writeln!(out, "{}", stats::line("guard_cost", "none", "idle", "other", &mut own, &mut limit))?;
    }
    for (bench, symptom) in [("trap_recovery", "crash.segv"), ("panic_recovery", "crash.panic")] {
        for (load, threads) in [("idle", 0), ("cpu100", 4)] {
            for sched in ["other", "fifo"] {
                if is_wanted(bench) {
                    let _load = Load::start(threads);
                    let (mut own, mut limit) = recovery::measure(symptom, sched, FAULTS);
                    writeln!(out, "{}", stats::line(bench, "fresh instance", load, sched, &mut own, &mut limit))?;
                }
            }
        }
    }
    Ok(())
}
