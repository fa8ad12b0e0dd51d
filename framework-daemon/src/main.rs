//! Calls the command line and turns its outcome into an exit code.

fn main() -> std::process::ExitCode {
    framework_daemon::cli::main()
}
