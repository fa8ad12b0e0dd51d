//! Compares `framework-daemon check --format json` with what OPRoS's own parser extracted from the same files.
//!
//! A program and not a script: a fresh machine has Rust and nothing else for certain.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, ExitCode};

use serde_json::Value;
use tests::daemon_binary::daemon_binary;

/// How many files one run of the daemon checks: command lines are not endless.
const BATCH: usize = 64;

/// What the original parser says about one file.
#[derive(Default)]
struct Oracle {
    root: String,
    ok: bool,
    lines: Vec<Vec<String>>,
}

#[derive(Default)]
struct Tally {
    compared: BTreeMap<String, usize>,
    refused_by_both: usize,
    others: usize,
    others_refused: Vec<String>,
    exceptions: Vec<String>,
    differences: Vec<String>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [exceptions, corpus] = arguments.as_slice() else {
        eprintln!("usage: scripts/conformance DIR");
        return ExitCode::from(2);
    };
    match compare(Path::new(exceptions), Path::new(corpus)) {
        Ok(tally) => report(&tally),
        Err(message) => {
            eprintln!("conformance: {message}");
            ExitCode::FAILURE
        }
    }
}

fn compare(exceptions: &Path, corpus: &Path) -> Result<Tally, String> {
    let exceptions = read_exceptions(exceptions)?;
    let oracle = read_oracle(&corpus.join("oracle.tsv"))?;
    let files: Vec<&String> = oracle.keys().collect();
    let mut tally = Tally::default();
    for batch in files.chunks(BATCH) {
        for (file, verdict) in batch.iter().zip(check(corpus, batch)?) {
            if let Some(expected) = oracle.get(*file) {
                judge(file, expected, &verdict, &exceptions, &mut tally);
            }
        }
    }
    Ok(tally)
}

fn report(tally: &Tally) -> ExitCode {
    for (root, count) in &tally.compared {
        println!("{count:>5} {root} compared");
    }
    println!("{:>5} refused by the original parser and here", tally.refused_by_both);
    println!(
        "{:>5} with other roots, which the original parser does not read; refused here: {}",
        tally.others,
        tally.others_refused.len()
    );
    tally.others_refused.iter().for_each(|line| println!("      {line}"));
    println!("{:>5} intended exceptions", tally.exceptions.len());
    tally.exceptions.iter().for_each(|line| println!("      {line}"));
    tally.differences.iter().for_each(|line| println!("DIFFERENCE {line}"));
    println!("differences: {}", tally.differences.len());
    if tally.differences.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn read_exceptions(path: &Path) -> Result<Vec<(String, String)>, String> {
    let text = std::fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    Ok(lines.filter_map(|line| line.split_once('\t')).map(|(part, why)| (part.to_owned(), why.to_owned())).collect())
}

/// Lines are bytes in whatever encoding the profile had: UTF-8 where they are, else the Korean code page.
fn read_oracle(path: &Path) -> Result<BTreeMap<String, Oracle>, String> {
    let bytes = std::fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut all: BTreeMap<String, Oracle> = BTreeMap::new();
    let mut current = String::new();
    for line in bytes.split(|byte| *byte == b'\n') {
        let text = match std::str::from_utf8(line) {
            Ok(text) => text.to_owned(),
            Err(_) => encoding_rs::EUC_KR.decode(line).0.into_owned(),
        };
        let fields: Vec<String> = text.trim_end_matches('\r').split('\t').map(unescape).collect();
        match fields.iter().map(String::as_str).collect::<Vec<_>>().as_slice() {
            ["FILE", file] => (*file).clone_into(&mut current),
            ["", "ROOT", root, rest @ ..] => {
                let oracle = all.entry(current.clone()).or_default();
                (oracle.root, oracle.ok) = ((*root).to_owned(), rest.first() == Some(&"ok"));
            }
            ["", kind, ..] if !kind.is_empty() => {
                all.entry(current.clone()).or_default().lines.push(fields.into_iter().skip(1).collect());
            }
            // What the original parser wrote on its log in between.
            _ => {}
        }
    }
    Ok(all)
}

fn unescape(field: &str) -> String {
    condense(&field.replace("\\t", "\t").replace("\\n", "\n").replace("\\r", "\r"))
}

fn condense(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn check(corpus: &Path, files: &[&String]) -> Result<Vec<Value>, String> {
    let paths = files.iter().map(|file| corpus.join(file));
    let run = Command::new(daemon_binary()).args(["check", "--format", "json", "--"]).args(paths).output();
    let output = run.map_err(|error| format!("cannot run the daemon: {error}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let parsed: Result<Vec<Value>, _> = text.lines().map(serde_json::from_str).collect();
    let verdicts = parsed.map_err(|error| format!("the daemon printed no JSON: {error}"))?;
    if verdicts.len() != files.len() {
        return Err(format!("{} verdicts of {} files", verdicts.len(), files.len()));
    }
    Ok(verdicts)
}

fn judge(file: &str, expected: &Oracle, verdict: &Value, exceptions: &[(String, String)], tally: &mut Tally) {
    let accepted = verdict["accepted"] == true;
    if expected.root == "other" {
        tally.others += 1;
        if !accepted {
            tally.others_refused.push(format!("{file}: {}", errors(verdict).join("; ")));
        }
        return;
    }
    if !expected.ok {
        if accepted {
            tally.differences.push(format!("{file}: accepted, refused by the original parser"));
        } else {
            tally.refused_by_both += 1;
        }
        return;
    }
    *tally.compared.entry(expected.root.clone()).or_default() += 1;
    if !accepted {
        match excuse(verdict, exceptions) {
            Some(reason) => tally.exceptions.push(format!("{file}: {reason}")),
            None => tally.differences.push(format!("{file}: refused: {}", errors(verdict).join("; "))),
        }
    }
    let found = facts_of_verdict(&verdict["profile"]);
    let wanted = facts_of_oracle(expected, &verdict["profile"]);
    for fact in wanted.iter().filter(|fact| !found.contains(fact)) {
        tally.differences.push(format!("{file}: not extracted: {fact}"));
    }
    for fact in found.iter().filter(|fact| !wanted.contains(fact)) {
        tally.differences.push(format!("{file}: not in the oracle: {fact}"));
    }
}

fn errors(verdict: &Value) -> Vec<String> {
    let diagnostics = verdict["diagnostics"].as_array().cloned().unwrap_or_default();
    let errors = diagnostics.iter().filter(|found| found["level"] == "error");
    errors.map(|found| format!("{}:{}: {}", found["line"], found["column"], text(&found["message"]))).collect()
}

/// The reason, where every error of the file is an intended one.
fn excuse(verdict: &Value, exceptions: &[(String, String)]) -> Option<String> {
    let mut reasons: Vec<&str> = Vec::new();
    for error in errors(verdict) {
        let (_, reason) = exceptions.iter().find(|(part, _)| error.contains(part))?;
        if !reasons.contains(&reason.as_str()) {
            reasons.push(reason);
        }
    }
    Some(reasons.join("; "))
}

fn text(value: &Value) -> String {
    condense(value.as_str().unwrap_or_default())
}

fn list<'a>(value: &'a Value, name: &str) -> &'a [Value] {
    value[name].as_array().map_or(&[], Vec::as_slice)
}

/// What the daemon extracted, each fact one line.
fn facts_of_verdict(profile: &Value) -> Vec<String> {
    let mut facts = vec![format!("name {}", text(&profile["name"]))];
    if profile["declared"].is_object() {
        facts.extend(facts_of_component(profile));
    }
    for slot in list(profile, "subcomponents") {
        facts.push(format!("sub {} {} {}", text(&slot["name"]), text(&slot["node"]), text(&slot["reference"])));
    }
    for export in list(profile, "exports") {
        facts.push(format!(
            "export {} {} {}",
            text(&export["component"]),
            text(&export["port"]),
            text(&export["name"])
        ));
    }
    for link in list(profile, "connections") {
        let end = |end: &Value| format!("{} {}", text(&end["component"]), text(&end["port"]));
        facts.push(format!("conn {} {} {}", text(&link["kind"]), end(&link["source"]), end(&link["target"])));
    }
    facts
}

fn facts_of_component(profile: &Value) -> Vec<String> {
    let declared = &profile["declared"];
    let mut facts = vec![
        format!("lib {} {}", text(&declared["library_type"]), text(&profile["library"])),
        format!("trigger {}", text(&declared["trigger"]).replace("non-periodic", "aperiodic")),
        format!("period {}", text(&declared["period"])),
        format!("priority {}", text(&declared["priority"])),
        format!("policy {}", text(&declared["policy"])),
        format!("creation {}", text(&declared["creation_type"])),
        format!("lifecycle {}", text(&declared["lifecycle"])),
    ];
    for property in list(profile, "properties") {
        facts.push(format!("prop {} {}", text(&property["name"]), text(&property["value"])));
    }
    for port in list(profile, "service_ports") {
        let usage = if port["provided"] == true { "prov" } else { "req" };
        let (name, kind, file) = (text(&port["name"]), text(&port["type_name"]), text(&port["reference"]));
        facts.push(format!("svc_{usage} {name} {kind} {file}"));
    }
    for (kind, ports) in [("data", "data_ports"), ("event", "event_ports")] {
        for port in list(profile, ports) {
            let usage = if port["usage"] == "input" { "in" } else { "out" };
            facts.push(format!("{kind}_{usage} {} {}", text(&port["name"]), text(&port["data_type"])));
        }
    }
    facts
}

/// What the original parser extracted, in the same words. Where it fills in a default, what the daemon found is put in
/// its place: nothing written is nothing written.
fn facts_of_oracle(oracle: &Oracle, profile: &Value) -> Vec<String> {
    let mut facts = Vec::new();
    for line in &oracle.lines {
        let field = |index: usize| line.get(index).map_or("", String::as_str);
        match field(0) {
            "name" => facts.push(format!("name {}", field(1))),
            "lib" => facts.push(format!("lib {} {}", field(1), field(2))),
            "sem" => facts.extend(facts_of_semantics(line, &profile["declared"])),
            "prop" => facts.push(format!("prop {} {}", field(1), field(2))),
            "sub" => facts.push(format!("sub {} {} {}", field(1), field(3), field(4))),
            "conn" => facts.push(format!("conn {}", line.get(1..).unwrap_or_default().join(" "))),
            "export" => {
                facts.push(format!("export {} {} {}", field(1), field(2), line.last().map_or("", String::as_str)));
            }
            service if service.starts_with("svc_") => {
                facts.push(format!("{service} {} {} {}", field(1), field(2), field(3)));
            }
            port if port.starts_with("data_") || port.starts_with("event_") => {
                facts.push(format!("{port} {} {}", field(1), field(2)));
                facts.extend(wrong_policy(line, profile));
            }
            other => facts.push(format!("unknown line {other}")),
        }
    }
    facts
}

fn facts_of_semantics(line: &[String], declared: &Value) -> Vec<String> {
    let field = |index: usize| line.get(index).map_or("", String::as_str);
    let defaulted = |value: &str, defaults: &[&str], found: &Value| {
        if defaults.contains(&value) && text(found).is_empty() { String::new() } else { value.to_owned() }
    };
    vec![
        format!("trigger {}", field(1)),
        format!("period {}", defaulted(field(2), &["0", "-1"], &declared["period"])),
        format!("priority {}", defaulted(field(3), &["0", "-1"], &declared["priority"])),
        format!("policy {}", defaulted(field(4), &["SCHED_OTHER"], &declared["policy"])),
        format!("creation {}", field(5)),
        format!("lifecycle {}", defaulted(field(6), &["start"], &declared["lifecycle"])),
    ]
}

/// The original parser reads one of the three spellings of a policy; where it found one, the daemon must have it too.
fn wrong_policy(line: &[String], profile: &Value) -> Option<String> {
    let (name, policy, size) = (line.get(1)?, line.get(3)?, line.get(4)?);
    if policy.is_empty() || !line.first()?.starts_with("data_") {
        return None;
    }
    let port = list(profile, "data_ports").iter().find(|port| text(&port["name"]) == *name)?;
    let queue = &port["queue"];
    let same = match policy.as_str() {
        "FIFO" => {
            queue["policy"] == "fifo"
                && (size.parse() == Ok(queue["size"].as_u64().unwrap_or(0)) || matches!(size.as_str(), "0" | "1"))
        }
        _ => queue["policy"] == "last",
    };
    (!same).then(|| format!("policy of {name}: {policy} {size}"))
}
