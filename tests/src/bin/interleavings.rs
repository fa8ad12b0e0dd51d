//! Random interleavings of the communication patterns; see `scripts/interleavings`.

use std::io::Write;
use std::process::ExitCode;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use clap::Parser;
use tests::sim::history::run;

/// Small systems, drawn by lot, live through random histories; a model says what must come of each step.
#[derive(Parser)]
struct Arguments {
    /// Steps of all histories together.
    #[arg(default_value_t = 10_000_000)]
    steps: u64,
    /// Of the first history; each has the next one. Without: another one each time.
    seed: Option<u64>,
    /// Instead: so many seconds on real threads, in a real daemon, with real faults.
    #[arg(long)]
    threads: Option<u64>,
}

fn main() -> std::io::Result<ExitCode> {
    let Arguments { steps, seed, threads } = Arguments::parse();
    if let Some(seconds) = threads {
        let crowd = tests::crowd::run(Duration::from_secs(seconds));
        println!("{}", crowd.text());
        return Ok(if crowd.problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE });
    }
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs();
    let (seed, began) = (seed.unwrap_or(wall), Instant::now());
    let mut out = std::io::stdout().lock();
    writeln!(out, "seed {seed}")?;
    let report = run(steps, seed);
    writeln!(out, "{}\n{:.1} s", report.text(), began.elapsed().as_secs_f64())?;
    Ok(if report.failure.is_none() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
