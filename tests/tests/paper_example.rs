//! The SmartSoft paper's example, as its README says it is run.

use std::path::{Path, PathBuf};

use tempfile::TempDir;
use tests::running::Running;

/// What a slot logged, in order.
fn said(daemon: &Running, slot: &str) -> Vec<String> {
    daemon.lines(&format!(" {slot}: "))
}

/// Seconds and nanoseconds in `… 12.000000345 s…`.
fn time(line: &str) -> (u64, u64) {
    let number = line.split_whitespace().find(|word| word.split('.').nth(1).is_some_and(|part| part.len() == 9));
    let (seconds, nanos) =
        number.and_then(|number| number.split_once('.')).unwrap_or_else(|| panic!("no time: {line}"));
    (seconds.parse().unwrap(), nanos.parse().unwrap())
}

fn profiles() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/paper_example")
}

#[test]
fn figures_7_and_8() {
    run(&profiles());
}

#[test]
fn figures_7_and_8_on_one_thread() {
    let scratch = TempDir::new().unwrap();
    for file in std::fs::read_dir(profiles()).unwrap().map(Result::unwrap) {
        std::fs::copy(file.path(), scratch.path().join(file.file_name())).unwrap();
    }
    let application = scratch.path().join("paper_example.xml");
    let text = std::fs::read_to_string(&application).unwrap();
    let placed = text.replace("</reference>", "</reference><executor>one</executor>");
    assert_ne!(text, placed);
    std::fs::write(application, placed).unwrap();
    let system = "<system_profile><name>s</name><executor name=\"one\"/></system_profile>";
    std::fs::write(scratch.path().join("system.xml"), system).unwrap();
    run(scratch.path());
}

/// Runs three rounds and looks at what both logged.
fn run(profiles: &Path) {
    let mut daemon = Running::start(profiles, &[]);
    daemon.wait_for("round 3: the time stamp");
    let slots = daemon.stop();
    let (first, second) = (said(&daemon, "first"), said(&daemon, "second"));
    for (round, lines) in first.chunks_exact(3).enumerate() {
        let starts = ["asked for a time stamp", "the scan of", "the time stamp: "];
        for (line, start) in lines.iter().zip(starts) {
            assert!(line.contains(&format!("round {}: {start}", round + 1)), "{line} of {first:#?}");
        }
        // What was asked first was answered first, and fetched last.
        assert!(time(&lines[2]) < time(&lines[1]), "{lines:#?}");
    }
    assert!(first.len() >= 9, "{first:#?}");
    for (number, line) in second.iter().enumerate() {
        assert!(line.contains(if number % 2 == 0 { "tells the time" } else { "scans with 181 rays" }), "{second:#?}");
    }
    assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
}
