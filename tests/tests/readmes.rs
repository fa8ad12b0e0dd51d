//! The commands in the READMEs of the profiles are as the programs want them.

use std::path::{Path, PathBuf};
use std::process::Command;

use tests::daemon_binary::daemon_binary;

fn profiles() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles")
}

fn help(program: &Path, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).arg("--help").output().expect("it runs");
    assert!(output.status.success(), "{program:?} {arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The commands in the code blocks of a README, lines that go on joined.
fn commands(readme: &str) -> Vec<String> {
    let blocks = readme.split("```").skip(1).step_by(2);
    let text: String = blocks.map(|block| block.trim_start_matches("sh").replace("\\\n", " ")).collect();
    text.lines().filter(|line| line.starts_with("target/release/")).map(str::to_owned).collect()
}

#[test]
fn every_option_in_a_readme_is_one_of_its_program_and_every_path_is_there() {
    let mut count = 0;
    for scenario in ["unplugged_sonar", "voting_sonars"] {
        let readme = std::fs::read_to_string(profiles().join(scenario).join("README.md")).expect("it has a README");
        for command in commands(&readme) {
            let words: Vec<&str> = command.split_whitespace().collect();
            let program = daemon_binary().with_file_name(words[0].trim_start_matches("target/release/"));
            let verbs: Vec<&str> =
                words[1..].iter().copied().take_while(|word| !word.starts_with("--") && !word.contains('/')).collect();
            let help = help(&program, &verbs);
            for option in words.iter().filter(|word| word.starts_with("--")) {
                assert!(help.contains(&format!("{option} ")), "{command}: {option}");
            }
            for path in words.iter().filter(|word| word.starts_with("profiles/")) {
                assert!(profiles().join("..").join(path).exists(), "{command}: {path}");
            }
            count += 1;
        }
    }
    assert_eq!(count, 6, "three commands for each");
}
