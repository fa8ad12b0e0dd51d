//! A long life under fault load; see `scripts/soak`.

use std::io::Write;
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use serde_json::json;
use tests::soak::{Sample, run};

/// Panics and traps mixed, as fast as they go, in one life of a daemon: what it holds must not grow.
#[derive(Parser)]
struct Arguments {
    /// Faults.
    #[arg(long, default_value_t = 1_000_000)]
    faults: u64,
    /// Form of the table.
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

/// Start-up is over by then.
const FIRST_MARK: u64 = 10_000;
const MARK_EVERY: u64 = 100_000;

fn main() -> std::io::Result<ExitCode> {
    let Arguments { faults, format } = Arguments::parse();
    let mut out = std::io::stdout().lock();
    let marks: Vec<u64> = std::iter::once(FIRST_MARK)
        .chain((1..).map(|count| count * MARK_EVERY))
        .take_while(|mark| *mark < faults)
        .collect();
    if format == Format::Text {
        writeln!(out, "{}", Sample::HEAD)?;
    }
    let soak = run(faults, &marks, |sample| {
        // A table that nobody reads is no reason to end.
        let _ = match format {
            Format::Text => writeln!(out, "{}", sample.text()),
            Format::Json => writeln!(out, "{}", sample.json()),
        };
    });
    let (rate, leak) = ((soak.journaled + soak.lost) as f64 / soak.took.as_secs_f64(), soak.leak_bytes());
    match format {
        Format::Text => {
            writeln!(
                out,
                "{} faults written down, {} only counted, {rate:.0} a second; {} instances left behind, {leak} bytes each",
                soak.journaled, soak.lost, soak.quarantined
            )?;
            soak.problems.iter().try_for_each(|problem| writeln!(out, "problem: {problem}"))?;
        }
        Format::Json => {
            let line = json!({"journaled": soak.journaled, "lost": soak.lost, "per_second": rate,
                "quarantined": soak.quarantined, "leak_bytes": leak, "problems": soak.problems});
            writeln!(out, "{line}")?;
        }
    }
    Ok(if soak.problems.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
