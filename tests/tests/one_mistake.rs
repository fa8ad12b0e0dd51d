//! One mistake gives one error: every profile that ships is spoilt in one place after the other, and what follows from a
//! mistake must not be told as well. No error is without a place, and no hint says nothing.

use std::path::{Path, PathBuf};

use framework_daemon::profile::diagnostic::Diagnostic;
use framework_daemon::profile::load::survey;
use framework_daemon::profile::source::{Source, Span};
use framework_daemon::profile::xml::{self, Element};
use tempfile::TempDir;

/// What is put in the place of a part of a file.
struct Slip {
    what: String,
    edits: Vec<(Span, String)>,
}

impl Slip {
    fn new(what: String, span: Span, text: &str) -> Self {
        Self { what, edits: vec![(span, text.to_owned())] }
    }

    fn is_no_name(&self) -> bool {
        ["misspelt", "nonsense", "unclosed"].iter().any(|word| self.what.starts_with(word))
    }

    fn applied(&self, text: &str) -> String {
        let mut spoilt = text.to_owned();
        let mut edits = self.edits.clone();
        edits.sort_by_key(|(span, _)| std::cmp::Reverse(span.start));
        for (span, with) in edits {
            spoilt.replace_range(span.start as usize..span.end as usize, &with);
        }
        spoilt
    }
}

/// A name with two letters swapped.
fn swapped(name: &str) -> String {
    let mut letters: Vec<char> = name.chars().collect();
    let at = letters.windows(2).rposition(|pair| pair[0] != pair[1]).unwrap_or(0);
    letters.swap(at, at + 1);
    letters.into_iter().collect()
}

/// Where the end tag's name of an element stands, and where the element ends.
fn end_of(text: &str, element: &Element) -> (Option<Span>, usize) {
    let from = element.name_span.end as usize;
    let mut quote = None;
    let mut bytes = text.bytes().enumerate().skip(from);
    let close = bytes.find(|(_, byte)| match (quote, byte) {
        (None, b'"' | b'\'') => {
            quote = Some(*byte);
            false
        }
        (Some(open), byte) if open == *byte => {
            quote = None;
            false
        }
        (None, b'>') => true,
        _ => false,
    });
    let close = close.expect("a start tag ends").0;
    if text.as_bytes()[close - 1] == b'/' {
        return (None, close + 1);
    }
    let tag = format!("</{}", element.name);
    let at = close + text[close..].find(&tag).expect("an element ends");
    let end = at + text[at..].find('>').expect("an end tag ends") + 1;
    (Some(Span::new(at + 2, element.name.len())), end)
}

/// What others refer to: without it they find nothing, and each place where they do is to be corrected.
fn is_identity(parent: &str, element: &Element, attribute: &str) -> bool {
    match (element.name.as_str(), attribute) {
        ("name" | "export_port_name", "") => {
            !matches!(parent, "application_profile" | "package_profile" | "system_profile")
        }
        ("voting" | "executor" | "node" | "property", "name") => true,
        // Which ports there are, and of which kind and direction they are.
        ("usage" | "port_dir", "") => true,
        _ => false,
    }
}

fn slips(text: &str, parent: &str, element: &Element, all: &mut Vec<Slip>) {
    let name = &element.name;
    let (end_tag, end) = end_of(text, element);
    let rename = |what: &str, to: &str| {
        let spans = [Some(element.name_span), end_tag].into_iter().flatten();
        Slip { what: format!("{what} <{name}>"), edits: spans.map(|span| (span, to.to_owned())).collect() }
    };
    if name.len() > 2 {
        all.push(rename("misspelt", &swapped(name)));
    }
    let is_leaf = element.children.is_empty();
    if is_leaf && !parent.is_empty() {
        all.push(rename("nonsense instead of", "zzyzx"));
        let whole = Span::new(element.name_span.start as usize - 1, end + 1 - element.name_span.start as usize);
        if !matches!((parent, name.as_str()), ("system_profile", "executor") | ("properties", "property")) {
            all.push(Slip::new(format!("no <{name}> in <{parent}>"), whole, ""));
        }
        let twice = format!("{0}{0}", &text[whole.start as usize..whole.end as usize]);
        all.push(Slip::new(format!("twice <{name}>"), whole, &twice));
    }
    if let Some(span) = end_tag {
        all.push(Slip {
            what: format!("unclosed <{name}>"),
            edits: vec![(
                Span::new(span.start as usize - 2, span.end as usize + 3 - span.start as usize),
                String::new(),
            )],
        });
    }
    if is_leaf && !element.text.is_empty() {
        let span = Span::new(element.text_span.start as usize, element.text.len());
        all.push(Slip::new(format!("nothing in <{name}> of <{parent}>"), span, ""));
        if !is_identity(parent, element, "") {
            for wrong in ["-1s", "zzyzx"] {
                all.push(Slip::new(format!("\"{wrong}\" in <{name}>"), span, wrong));
            }
        }
    }
    for attribute in &element.attributes {
        let of = format!("{} of <{name}>", attribute.name);
        if attribute.name.len() > 2 {
            all.push(Slip::new(format!("misspelt {of}"), attribute.name_span, &swapped(&attribute.name)));
        }
        all.push(Slip::new(format!("nonsense instead of {of}"), attribute.name_span, "zzyzx"));
        let start = attribute.name_span.start as usize;
        let whole = Span::new(start, attribute.value_span.end as usize + 1 - start);
        if (name, attribute.name.as_str()) != (&"voting".to_owned(), "name") {
            all.push(Slip::new(format!("no {of}"), whole, ""));
        }
        all.push(Slip::new(format!("nothing in {of}"), attribute.value_span, ""));
        if !is_identity(parent, element, &attribute.name) {
            for wrong in ["-1s", "zzyzx"] {
                all.push(Slip::new(format!("\"{wrong}\" in {of}"), attribute.value_span, wrong));
            }
        }
    }
    element.children.iter().for_each(|child| slips(text, name, child, all));
}

fn profiles(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles").join(name)
}

fn wrong(found: &[Diagnostic]) -> Option<&'static str> {
    let mut errors = found.iter().filter(|finding| finding.is_error());
    if found.iter().any(|finding| finding.hint.as_deref() == Some("")) {
        return Some("a hint says nothing");
    }
    let (first, second) = (errors.next(), errors.next());
    if second.is_some() {
        return Some("several errors");
    }
    first.filter(|error| error.location.line == 0).map(|_| "an error without a place")
}

/// Spoils the files of a directory that `chosen` picks by their root.
fn spoil(name: &str, chosen: impl Fn(&str) -> bool) {
    let dir = TempDir::new().expect("a temporary directory");
    let files: Vec<PathBuf> =
        std::fs::read_dir(profiles(name)).expect("it ships").map(|entry| entry.unwrap().path()).collect();
    let files: Vec<PathBuf> =
        files.into_iter().filter(|path| path.extension().is_some_and(|end| end == "xml")).collect();
    for path in &files {
        std::fs::copy(path, dir.path().join(path.file_name().unwrap())).expect("a copy");
    }
    assert!(survey(dir.path()).diagnostics.iter().all(|finding| !finding.is_error()), "{name} is accepted as it ships");
    let (mut count, mut failed) = (0, Vec::new());
    for path in &files {
        let text = std::fs::read_to_string(path).expect("UTF-8");
        let root = xml::parse(&Source::from_text(path, text.clone())).expect("well-formed");
        if !chosen(&root.name) {
            continue;
        }
        let mut all = Vec::new();
        slips(&text, "", &root, &mut all);
        let copy = dir.path().join(path.file_name().unwrap());
        for slip in all {
            std::fs::write(&copy, slip.applied(&text)).expect("written");
            let found = survey(dir.path()).diagnostics;
            count += 1;
            // What nothing is called is refused, whatever is forgiven that follows from it.
            let is_refused = found.iter().any(Diagnostic::is_error);
            let passed = slip.is_no_name() && !is_refused;
            if let Some(why) = wrong(&found).or_else(|| passed.then_some("accepted")) {
                let errors: Vec<String> = found.iter().filter(|one| one.is_error()).map(ToString::to_string).collect();
                failed.push(format!("{}, {}: {why}\n{}", path.display(), slip.what, errors.join("\n")));
            }
        }
        std::fs::write(&copy, &text).expect("written");
    }
    assert!(count > 50, "only {count} mistakes");
    assert!(failed.is_empty(), "{} of {count}:\n\n{}", failed.len(), failed.join("\n\n"));
}

/// Components are of one kind everywhere: those of one directory stand for all.
fn not_components(root: &str) -> bool {
    root != "component_profile"
}

#[test]
fn in_the_voting_sonars() {
    spoil("voting_sonars", not_components);
}

#[test]
fn in_the_encoder_monitor() {
    spoil("encoder_monitor", not_components);
}

#[test]
fn in_the_navigation() {
    spoil("navigation", not_components);
}

#[test]
fn in_the_unplugged_sonar() {
    spoil("unplugged_sonar", |_| true);
}

#[test]
fn in_all_that_has_rules_of_every_kind() {
    spoil("doubtful/not-active-yet", |_| true);
}
