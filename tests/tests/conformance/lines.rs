//! Every line of the tables has its test, or says why we chose differently: `lines.tsv` lists them, and this checks that what it
//! names is there.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

const LINES: &str = include_str!("lines.tsv");

/// How many lines the tables of a section have in the list: one that is lost is missed.
const SECTIONS: [(&str, usize); 19] = [
    ("1.1", 24),
    ("1.2", 16),
    ("1.2.1", 5),
    ("1.2.2", 3),
    ("1.3", 5),
    ("1.4", 15),
    ("1.5", 7),
    ("1.6", 9),
    ("1.7", 3),
    ("1.8", 14),
    ("1.9", 12),
    ("1.10", 17),
    ("1.11", 1),
    ("1.12", 9),
    ("1.13", 7),
    ("1.14", 2),
    ("1.15", 17),
    ("1.16", 14),
    ("1.17", 4),
];

/// The names of a pattern's cases, with its module.
macro_rules! names {
    ($module:literal; $($name:ident),+ $(,)?) => { [$(concat!($module, "::", stringify!($name))),+].as_slice() };
}

/// A module of this suite, and its text.
macro_rules! texts {
    ($($module:literal),+ $(,)?) => { [$(($module, include_str!(concat!($module, ".rs")))),+] };
}

/// A line of the tables.
struct Line {
    section: &'static str,
    name: &'static str,
    tests: &'static str,
}

fn lines() -> Vec<Line> {
    let lines = LINES.lines().filter(|line| !line.starts_with('#'));
    let fields = |line: &'static str| {
        let mut fields = line.split('\t');
        let [section, name, tests] = [fields.next(), fields.next(), fields.next()].map(Option::unwrap_or_default);
        assert!(fields.next().is_none() && !tests.is_empty(), "not a line of three fields: {line}");
        Line { section, name, tests }
    };
    lines.map(fields).collect()
}

/// The functions of a text that are tests.
fn tests_of(text: &str) -> impl Iterator<Item = &str> {
    let after = text.split("#[test]\n").skip(1);
    after.filter_map(|rest| rest.trim_start().strip_prefix("fn ")?.split('(').next())
}

/// All tests of this suite: those that plugins run as cases, and those of its modules.
fn suite() -> BTreeSet<String> {
    let cases = [
        events::event_cases!(names "event";),
        links::paper_cases!(names "paper";),
        links::requestor_cases!(names "requestor";),
        links::wiring_cases!(names "wiring";),
        pushes::push_cases!(names "push";),
        queries::query_cases!(names "query";),
        sends::send_cases!(names "send";),
        sends::service_cases!(names "service";),
        states::state_cases!(names "state";),
        tasks::task_cases!(names "threads";),
    ];
    let own = texts![
        "allocation",
        "check",
        "component",
        "event",
        "patterns",
        "push",
        "query",
        "requestor",
        "send",
        "service",
        "status",
        "threads",
        "wiring"
    ];
    let own = own.into_iter().flat_map(|(module, text)| tests_of(text).map(move |test| format!("{module}::{test}")));
    cases.into_iter().flatten().map(|case| (*case).to_owned()).chain(own).collect()
}

/// True of a test in another file of the repository.
fn is_elsewhere(test: &str) -> bool {
    let Some((file, name)) = test.split_once("::").filter(|(file, _)| file.contains('/')) else { return false };
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let text = std::fs::read_to_string(root.join(file)).unwrap_or_default();
    tests_of(&text).any(|test| test == name)
}

#[test]
fn every_line_of_the_tables_has_its_test_or_a_reason() {
    let (suite, lines) = (suite(), lines());
    let mut missing = Vec::new();
    for Line { section, name, tests } in &lines {
        if let Some(reason) = tests.strip_prefix("- ") {
            assert!(reason.len() > 20, "{section} {name}: a reason in words");
        }
        // A reason may name tests, too.
        let is_test = |word: &&str| !tests.starts_with("- ") || word.contains("::");
        let words = tests.split([' ', '(', ')']).map(|word| word.trim_end_matches(['.', ','])).filter(is_test);
        let gone = words.filter(|test| !suite.contains(*test) && !is_elsewhere(test));
        missing.extend(gone.map(|test| format!("{section} {name}: {test}")));
    }
    assert!(missing.is_empty(), "tests that are not there:\n{}", missing.join("\n"));
}

#[test]
fn no_line_of_the_tables_is_missing_or_twice() {
    let lines = lines();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    lines.iter().for_each(|line| *counts.entry(line.section).or_default() += 1);
    assert_eq!(counts, SECTIONS.into_iter().collect());
    let names: BTreeSet<_> = lines.iter().map(|line| (line.section, line.name)).collect();
    assert_eq!(names.len(), lines.len(), "two lines of one name");
}
