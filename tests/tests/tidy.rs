//! Reads the source and keeps the style: layer order, addresses of unsafe, lengths, banned calls, documentation.
//!
//! Every message is `path:line: what is wrong, what to do`.

use std::path::{Path, PathBuf};

/// A module of the daemon may use only modules to its left.
const LAYERS: [&str; 12] =
    ["model", "sys", "detect", "profile", "plugin", "port", "exec", "fault", "supervise", "control", "daemon", "cli"];

/// Where unsafe code may live. Each file opens with `#![allow(unsafe_code, reason = "address of unsafe: ...")]`, or allows
/// it for one function.
const UNSAFE: &[&str] = &[
    "component-sdk/derive/src/comm_object.rs",
    "component-sdk/src/abi/calls.rs",
    "component-sdk/src/abi/events.rs",
    "component-sdk/src/abi/export.rs",
    "component-sdk/src/abi/host.rs",
    "component-sdk/src/abi/inject.rs",
    "component-sdk/src/abi/payload.rs",
    "component-sdk/src/abi/push.rs",
    "component-sdk/src/abi/task.rs",
    "component-sdk/src/object/flat.rs",
    "component-sdk/src/object/path.rs",
    "component-sdk/src/object/scalar.rs",
    "component-sdk/src/object/sequence.rs",
    "component-sdk/src/object/text.rs",
    "component-sdk/src/testing/calls.rs",
    "component-sdk/src/testing/sends.rs",
    "component-sdk/src/testing/events.rs",
    "component-sdk/src/testing/mod.rs",
    "framework-daemon/src/exec/checkpoint.rs",
    "framework-daemon/src/exec/lane.rs",
    "framework-daemon/src/plugin/instance.rs",
    "framework-daemon/src/plugin/library.rs",
    "framework-daemon/src/plugin/task.rs",
    "framework-daemon/src/port/block.rs",
    "framework-daemon/src/port/border.rs",
    "framework-daemon/src/port/check.rs",
    "framework-daemon/src/port/rule.rs",
    "framework-daemon/src/port/exchange.rs",
    "framework-daemon/src/port/input.rs",
    "framework-daemon/src/port/output.rs",
    "framework-daemon/src/port/own.rs",
    "framework-daemon/src/port/pattern/direct.rs",
    "framework-daemon/src/port/pattern/requestor.rs",
    "framework-daemon/src/port/tap.rs",
    "framework-daemon/src/sys/arch/aarch64.rs",
    "framework-daemon/src/sys/arch/mod.rs",
    "framework-daemon/src/sys/arch/x86_64.rs",
    "framework-daemon/src/sys/carrier.rs",
    "framework-daemon/src/sys/clock.rs",
    "framework-daemon/src/sys/copy.rs",
    "framework-daemon/src/sys/fence.rs",
    "framework-daemon/src/sys/fiber.rs",
    "framework-daemon/src/sys/foreign.rs",
    "framework-daemon/src/sys/futex.rs",
    "framework-daemon/src/sys/grave.rs",
    "framework-daemon/src/sys/heap.rs",
    "framework-daemon/src/sys/last_words.rs",
    "framework-daemon/src/sys/leaf.rs",
    "framework-daemon/src/sys/mapping.rs",
    "framework-daemon/src/sys/memory.rs",
    "framework-daemon/src/sys/safe_outputs.rs",
    "framework-daemon/src/sys/seen.rs",
    "framework-daemon/src/sys/shield/descriptors.rs",
    "framework-daemon/src/sys/shield/handlers.rs",
    "framework-daemon/src/sys/shield/leave.rs",
    "framework-daemon/src/sys/shield/limits.rs",
    "framework-daemon/src/sys/shield/mod.rs",
    "framework-daemon/src/sys/shield/opens.rs",
    "framework-daemon/src/sys/shield/replace.rs",
    "framework-daemon/src/sys/shield/send.rs",
    "framework-daemon/src/sys/shield/signals.rs",
    "framework-daemon/src/sys/shield/threads.rs",
    "framework-daemon/src/sys/shield/waits.rs",
    "framework-daemon/src/sys/stack.rs",
    "framework-daemon/src/sys/streams.rs",
    "framework-daemon/src/sys/text.rs",
    "framework-daemon/src/sys/thread.rs",
    "framework-daemon/src/sys/trap.rs",
    "framework-daemon/src/sys/watchdog.rs",
];

const FILE_LINES_MAX: usize = 600;

/// What nobody calls in the daemon, and what to call instead.
const BANNED: [(&str, &str); 8] = [
    ("process::exit(", "an exit code returned from main"),
    ("libc::fork", "posix_spawn: handlers of fork take every allocator lock"),
    ("libc::longjmp", "a fiber that ends"),
    ("dlclose", "nothing: a Rust library is never closed"),
    ("println!(", "writeln! to the writer that the verb was given"),
    ("std::thread::park", "sys::wake"),
    (".unwrap()", "an error, or `expect` with the reason why it cannot fail"),
    ("libc::pthread_cancel", "a deadline, then leave it behind"),
];

struct Source {
    path: String,
    /// Lines before the unit tests, which come last in every file.
    code: Vec<String>,
    lines: usize,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

fn sources() -> Vec<Source> {
    let mut paths = Vec::new();
    for folder in ["component-sdk", "framework-daemon", "components", "tests"] {
        walk(&root().join(folder), &mut paths);
    }
    paths.sort();
    paths.iter().map(|path| Source::read(path)).collect()
}

fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let path = entry.path();
        if path.is_dir() && !path.ends_with("target") {
            walk(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

impl Source {
    fn read(path: &Path) -> Self {
        let text = std::fs::read_to_string(path).unwrap();
        let is_test = |line: &&str| line.starts_with("#[cfg(test)]") || line.starts_with("#![cfg(test)]");
        let code = text.lines().take_while(|line| !is_test(line)).map(str::to_owned).collect();
        let path = path.strip_prefix(root()).unwrap().display().to_string();
        Self { path, code, lines: text.lines().count() }
    }

    /// Lines of code without comments, numbered from 1.
    fn numbered(&self) -> impl Iterator<Item = (usize, &str)> {
        let lines = self.code.iter().enumerate().map(|(index, line)| (index + 1, line.as_str()));
        lines.map(|(number, line)| (number, line.split("//").next().unwrap_or_default()))
    }
}

fn report(problems: &[String]) {
    assert!(problems.is_empty(), "\n{}\n", problems.join("\n"));
}

#[test]
fn a_module_uses_only_modules_to_its_left() {
    let mut problems = Vec::new();
    for source in sources() {
        let Some(inner) = source.path.strip_prefix("framework-daemon/src/") else { continue };
        let own = inner.split(['/', '.']).next().unwrap_or_default();
        let Some(layer) = LAYERS.iter().position(|name| *name == own) else { continue };
        for (number, line) in source.numbered() {
            for used in line.split("crate::").skip(1) {
                let used = used.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default();
                if LAYERS.iter().position(|name| *name == used).is_some_and(|other| other > layer) {
                    problems.push(format!(
                        "{}:{number}: `{own}` must not use `{used}`: move what both need to the left",
                        source.path
                    ));
                }
            }
        }
    }
    report(&problems);
}

#[test]
fn unsafe_has_an_address() {
    let mut problems = Vec::new();
    for source in sources() {
        let listed = UNSAFE.contains(&source.path.as_str());
        let found = source
            .numbered()
            .find(|(_, line)| line.contains("unsafe {") || line.contains("unsafe fn") || line.contains("unsafe impl"));
        match found {
            Some((number, _)) if !listed && !source.path.starts_with("tests/") => {
                problems.push(format!(
                    "{}:{number}: unsafe code has its addresses in tests/tests/tidy.rs: move it to one",
                    source.path
                ));
            }
            None if listed => {
                problems.push(format!("{}:1: no unsafe code left here: take it off the list", source.path));
            }
            _ => {}
        }
    }
    report(&problems);
}

#[test]
fn no_file_is_too_long_and_each_opens_with_its_purpose() {
    let mut problems = Vec::new();
    for source in sources() {
        if source.lines > FILE_LINES_MAX {
            problems.push(format!(
                "{}:{}: longer than {FILE_LINES_MAX} lines: split it by responsibility",
                source.path, source.lines
            ));
        }
        if !source.code.first().is_some_and(|line| line.starts_with("//!") || line.starts_with("#!")) {
            problems.push(format!("{}:1: open with a `//!` line that says what the file is for", source.path));
        }
    }
    report(&problems);
}

#[test]
fn nobody_calls_what_is_banned() {
    let mut problems = Vec::new();
    for source in sources().iter().filter(|source| source.path.starts_with("framework-daemon/src/")) {
        for (number, line) in source.numbered() {
            for (call, instead) in BANNED.iter().filter(|(call, _)| line.contains(call)) {
                // `eprintln!(` contains `println!(` and has one place: the signal thread that is about to leave.
                if *call == "println!(" && line.contains("eprintln!(") {
                    continue;
                }
                problems.push(format!("{}:{number}: `{call}` is banned here, use {instead}", source.path));
            }
        }
    }
    report(&problems);
}

#[test]
fn every_verb_is_in_the_readme() {
    use clap::CommandFactory;
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let missing: Vec<String> = framework_daemon::cli::Cli::command()
        .get_subcommands()
        .filter(|verb| !verb.is_hide_set())
        .map(|verb| format!("`{}", verb.get_name()))
        .filter(|verb| !readme.contains(verb))
        .map(|verb| format!("README.md:1: the verb {verb}` is not documented"))
        .collect();
    report(&missing);
}

#[test]
fn every_component_is_a_small_product() {
    let mut problems = Vec::new();
    for entry in std::fs::read_dir(root().join("components")).unwrap().map(Result::unwrap) {
        let path = entry.path();
        let manifest = std::fs::read_to_string(path.join("Cargo.toml")).unwrap_or_default();
        let name = entry.file_name().into_string().unwrap();
        let wanted: &[&str] =
            if manifest.contains("cdylib") { &["README.md", "profile.xml", "tests"] } else { &["README.md"] };
        // A plugin of several classes has them in the directory of its application.
        let has = |file: &str| {
            path.join(file).exists() || file == "profile.xml" && root().join("profiles").join(&name).exists()
        };
        for file in wanted.iter().filter(|file| !has(file)) {
            problems.push(format!("components/{name}:1: {file} is missing"));
        }
    }
    report(&problems);
}
