//! Random histories of faults on random dependency graphs; see `scripts/histories`.

use std::io::Write;
use std::process::ExitCode;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use clap::Parser;
use tests::histories::run_on;

/// Small systems, drawn by lot, live through random histories of faults and orders; a naive model says what must come of each.
#[derive(Parser)]
struct Arguments {
    /// How many.
    #[arg(default_value_t = 10_000_000)]
    histories: u64,
    /// Of the first history; each has the next one. Without: another one each time.
    seed: Option<u64>,
}

fn main() -> std::io::Result<ExitCode> {
    let Arguments { histories, seed } = Arguments::parse();
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let (seed, began) = (seed.unwrap_or(wall), Instant::now());
    let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    let mut out = std::io::stdout().lock();
    writeln!(out, "seed {seed}")?;
    let report = run_on(threads.min(histories.max(1)), histories, seed);
    writeln!(out, "{}\n{:.1} s", report.text(), began.elapsed().as_secs_f64())?;
    Ok(if report.failure.is_none() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
