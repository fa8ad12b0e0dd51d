//! Draws the paper's figure 10 from runs of the daemon: `scripts/figure10 [FILE]`, by default `target/figure10.svg`.

use std::path::PathBuf;
use std::process::ExitCode;

use navigation_tests::figure10::draw;
use navigation_tests::power_off::{Failure, Programs, WINDOWS_MS, measure};

fn main() -> ExitCode {
    match figure10() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("figure10: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn figure10() -> Result<(), Failure> {
    let file = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "target/figure10.svg".to_owned()));
    let programs = Programs::beside_this()?;
    let mut runs = Vec::new();
    for (number, window_ms) in WINDOWS_MS.into_iter().enumerate() {
        println!(
            "run {} of {}: the robot drives, and after a second its left wheels have no power",
            number + 1,
            WINDOWS_MS.len()
        );
        let run = measure(&programs, window_ms, &mut |what| println!("  {what}"))?;
        let (found, difference) = (run.found_after_ms(), run.found.difference);
        println!("  window {window_ms} ms: found after {found:.0} ms, filtered difference {difference:.0} ticks/s");
        runs.push(run);
    }
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder)?;
    }
    std::fs::write(&file, draw(&runs))?;
    println!("{}", file.display());
    Ok(())
}
