//! Runs the torture campaign and prints a table; see `scripts/torture`.

use std::io::Write;
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use tests::campaign::classes::{CLASSES, Class};
use tests::campaign::layout::Policy;
use tests::campaign::row::HEAD;
use tests::campaign::run;

/// Each class of misbehaviour again and again, in one life of a daemon, beside twenty other slots at 1 kHz.
#[derive(Parser)]
struct Arguments {
    /// Classes or groups; all without any.
    classes: Vec<String>,
    /// Strikes of each class.
    #[arg(long, default_value_t = 100)]
    faults: usize,
    /// How the daemon's threads are scheduled.
    #[arg(long, value_enum, default_value = "both")]
    sched: Sched,
    /// Form of the table.
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

#[derive(Clone, Copy, ValueEnum)]
enum Sched {
    Other,
    Fifo,
    Both,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    Text,
    Json,
}

impl Sched {
    const fn policies(self) -> &'static [Policy] {
        match self {
            Self::Other => &[Policy::Other],
            Self::Fifo => &[Policy::Fifo],
            Self::Both => &[Policy::Other, Policy::Fifo],
        }
    }
}

/// Tries of a class whose others missed periods: one may be the machine's, not all.
const TRIES: usize = 3;

fn main() -> std::io::Result<ExitCode> {
    let arguments = Arguments::parse();
    let wanted = |class: &&Class| {
        let named = |asked: &String| *asked == class.name() || asked == class.component || asked == class.group;
        arguments.classes.is_empty() || arguments.classes.iter().any(named)
    };
    let (mut out, mut err) = (std::io::stdout().lock(), std::io::stderr());
    if arguments.format == Format::Text {
        writeln!(out, "{HEAD}")?;
    }
    let mut failed = 0;
    for policy in arguments.sched.policies() {
        for class in CLASSES.iter().filter(wanted) {
            writeln!(err, "{} ({})", class.name(), policy.name())?;
            let rows = (0..TRIES).map(|_| run::run(class, arguments.faults, *policy));
            let mut rows =
                rows.scan(false, |done, row| (!std::mem::replace(done, row.missed_beyond() == 0)).then_some(row));
            let mut row = rows.by_ref().last().expect("there is one try at least");
            if row.missed_beyond() > 0 {
                row.problems.push(format!("others missed {} periods too many", row.missed_beyond()));
            }
            failed += usize::from(!row.problems.is_empty());
            match arguments.format {
                Format::Text => writeln!(out, "{}", row.text())?,
                Format::Json => writeln!(out, "{}", row.json())?,
            }
        }
    }
    writeln!(err, "{failed} rows with problems")?;
    Ok(if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
