//! `check`, `schema`, `graph`, `completions`, `man` as a user meets them: output and exit codes.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use tests::daemon_binary::daemon_binary;

fn profiles() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles")
}

fn run(arguments: &[&str]) -> Output {
    Command::new(daemon_binary()).current_dir(profiles()).args(arguments).output().expect("the daemon runs")
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn check_prints_one_json_object_a_file_with_all_that_was_extracted() {
    let output = run(&["check", "--format", "json", "doubtful/type-names-differ"]);
    assert_eq!(output.status.code(), Some(0));
    let objects: Vec<Value> = text(&output).lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(objects.len(), 4);
    let app = objects.iter().find(|object| object["root"] == "application_profile").expect("the application");
    assert_eq!(app["accepted"], true);
    assert_eq!(app["file"], "doubtful/type-names-differ/app.xml");
    assert_eq!(app["profile"]["subcomponents"][0]["name"], "sonar");
    assert_eq!(app["diagnostics"][0]["level"], "warning");
    assert!(app["diagnostics"][0]["line"].as_u64() > Some(0));
}

#[test]
fn check_of_single_files_does_not_look_for_others() {
    let output = run(&["check", "broken/reference-not-found/app.xml", "broken/reference-not-found/Sonar.xml"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(run(&["check", "broken/connection-unknown-slot/app.xml"]).status.code(), Some(3));
}

#[test]
fn check_answers_what_is_no_file() {
    let output = run(&["check", "not/there.xml"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(text(&output).starts_with("not/there.xml: error: cannot be read"), "{}", text(&output));
    assert_eq!(run(&["check"]).status.code(), Some(2));
    assert_eq!(run(&["chekc"]).status.code(), Some(2));
}

#[test]
fn every_schema_is_printed() {
    for kind in ["system", "application", "component", "composite", "data-type", "service"] {
        let output = run(&["schema", kind]);
        assert!(output.status.success() && text(&output).contains("<xs:schema"), "{kind}");
    }
}

#[test]
fn graphs_name_every_slot_and_port() {
    for (format, begin) in [("dot", "digraph"), ("mermaid", "flowchart"), ("svg", "<svg")] {
        let output = run(&["graph", "doubtful/not-active-yet", "--as", format]);
        assert!(output.status.success());
        let drawn = text(&output);
        assert!(drawn.starts_with(begin), "{drawn}");
        for name in ["sonar", "avoider", "motors", "heading"] {
            assert!(drawn.contains(name), "{format} lacks {name}");
        }
    }
    let refused = run(&["graph", "broken/connection-reversed"]);
    assert_eq!(refused.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("reversed"));
}

#[test]
fn completions_and_manual_know_every_verb() {
    for arguments in [&["completions", "bash"][..], &["man"]] {
        let output = run(arguments);
        assert!(output.status.success());
        for verb in ["check", "graph", "schema"] {
            assert!(text(&output).contains(verb), "{arguments:?} lacks {verb}");
        }
    }
}
