//! The command line: one file per verb, exit codes in one enum.

/// Parses the arguments, runs the verb and returns its exit code.
pub fn main() -> std::process::ExitCode {
    std::process::ExitCode::SUCCESS
}
