//! Every broken profile gives its diagnostic at the right line and column, through the real binary.
//!
//! `UPDATE_GOLDEN=1 cargo test -p tests --test diagnostics` writes the expectations anew; read the difference.

use std::path::{Path, PathBuf};
use std::process::Command;

use tests::daemon_binary::daemon_binary;

fn profiles(kind: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles").join(kind)
}

/// Name, expectation and what the daemon says, of each directory under `profiles/kind`.
fn mismatches(kind: &str, exit: i32) -> (usize, Vec<String>) {
    let dir = profiles(kind);
    let entries = std::fs::read_dir(&dir).expect("the examples exist");
    let mut cases: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| dir.join(name).is_dir())
        .collect();
    cases.sort();
    let wrong = cases.iter().filter_map(|case| mismatch(&dir, case, exit)).collect();
    (cases.len(), wrong)
}

fn mismatch(dir: &Path, case: &str, exit: i32) -> Option<String> {
    let run = Command::new(daemon_binary()).current_dir(dir).args(["check", case]).output();
    let output = run.expect("the daemon runs");
    let found = String::from_utf8_lossy(&output.stdout).into_owned();
    let golden = dir.join(case).join("expected.txt");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&golden, &found).expect("the expectation can be written");
    }
    let expected = std::fs::read_to_string(&golden).unwrap_or_default();
    let stderr = String::from_utf8_lossy(&output.stderr);
    let same = found == expected && output.status.code() == Some(exit) && stderr.is_empty();
    (!same)
        .then(|| format!("{case}: exit {:?}\n--- expected\n{expected}--- found\n{found}{stderr}", output.status.code()))
}

#[test]
fn every_broken_profile_is_refused_with_its_diagnostic() {
    let (count, wrong) = mismatches("broken", 3);
    assert!(count >= 45, "only {count} broken profiles");
    assert!(wrong.is_empty(), "{} of {count} differ:\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn every_doubtful_profile_is_accepted_with_its_warning() {
    let (count, wrong) = mismatches("doubtful", 0);
    assert!(count >= 5, "only {count} doubtful profiles");
    assert!(wrong.is_empty(), "{} of {count} differ:\n{}", wrong.len(), wrong.join("\n"));
}

/// What makes more than one mistake, on purpose.
const SEVERAL_MISTAKES: [&str; 6] = [
    "composite-property-of-nobody",
    "everything-at-once",
    "model-of-an-input",
    "model-without-port",
    "usage-unknown",
    "voting-of-inputs",
];

#[test]
fn one_mistake_is_one_error_and_no_hint_says_nothing() {
    for kind in ["broken", "doubtful"] {
        let entries = std::fs::read_dir(profiles(kind)).expect("the examples exist").flatten();
        for entry in entries.filter(|entry| entry.path().is_dir()) {
            let text = std::fs::read_to_string(entry.path().join("expected.txt")).unwrap_or_default();
            assert!(!text.lines().any(|line| line.trim() == "="), "an empty hint:\n{text}");
            let name = entry.file_name().to_string_lossy().into_owned();
            let errors = text.lines().filter(|line| line.contains(": error: ")).count();
            let one = usize::from(kind == "broken");
            assert!(errors == one || SEVERAL_MISTAKES.contains(&name.as_str()), "{errors} errors:\n{text}");
        }
    }
}

#[test]
fn every_broken_profile_says_a_line_and_a_column_unless_it_is_about_the_directory() {
    let entries = std::fs::read_dir(profiles("broken")).expect("the examples exist").flatten();
    for entry in entries.filter(|entry| entry.path().is_dir()) {
        let text = std::fs::read_to_string(entry.path().join("expected.txt")).unwrap_or_default();
        let errors: Vec<&str> = text.lines().filter(|line| line.contains(": error: ")).collect();
        assert!(!errors.is_empty(), "{} expects no error", entry.path().display());
        let located = |line: &&str| line.split(':').nth(2).is_some_and(|column| column.parse::<u32>().is_ok());
        let whole = |line: &&str| {
            ["no application_profile", "second system_profile", "declares encoding"]
                .iter()
                .any(|part| line.contains(part))
        };
        assert!(errors.iter().all(|line| located(line) || whole(line)), "{errors:?}");
    }
}
