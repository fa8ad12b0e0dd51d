//! `run`: load, start, supervise until told to stop.

use std::io::{self, Write};
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use component_sdk::abi::inject::{self, INJECTIONS};

use super::exit_code::Exit;
use crate::daemon::{self, Ending, Injection, RunError, Settings};
use crate::exec::keep;
use crate::model::limits::SHUTDOWN_STEP;
use crate::plugin::probe;
use crate::sys::log_ring::{self, Lines};
use crate::sys::place;

const EXAMPLES: &str = "Examples:\n  framework-daemon run profiles/navigation --plugins target/release\n  \
     framework-daemon run profiles/navigation --inject avoider:crash.segv@5\n\n\
     When all slots run, a line that begins with `ready` is printed.\n\n\
     Signals: SIGHUP reads the profiles again, all or nothing. SIGTERM and SIGINT end the run in order; a second one ends it at \
     once. SIGUSR1 writes the status of all slots into log and journal.\n\n\
     Asking: `status`, `fault follow`, `reload` and others ask by the control socket. Where the usual place for it cannot be had \
     the daemon runs without one; a place that is named by --socket must be had.\n\n\
     Checkpoints: after a crash, a kill or a restart for suspect memory, slots with a `<checkpoint>` go on from their last one, \
     unless --fresh is given or the plugin is another build. After an end in order all begin anew.\n\n\
     Emergency stop: once latched it stays so, also in the next run, until `fault clear`, or a start with --fresh.\n\n\
     Provoking faults: --inject takes crash.panic, crash.segv, crash.bus, crash.fpe, crash.ill, crash.abort, crash.stack, \
     crash.exit, error, hang, raised, overrun (where there is a <deadline>), device (a device called `injected` is lost) and \
     device.found. `daemon` in place of a slot is the daemon itself (crash.segv, crash.abort, crash.panic): it writes the \
     safe outputs of its actuators and a crash record, and ends by the signal.\n\n\
     The log goes to stderr; RUST_LOG=warn, for example, has it say less.\n\n\
     Exit codes: 0 ended in order, 1 failed or to be started again, 2 wrong usage, 3 a profile is invalid, 4 a plugin is refused.";

/// Long enough for the log's thread to write what it has; short enough for motors that turn meanwhile.
const PANIC_FLUSH: Duration = Duration::from_millis(20);

/// Arguments of `run`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// Profile directory: an application_profile or several, what they refer to, and a system_profile if there is one.
    #[arg(value_name = "DIR")]
    pub directory: PathBuf,
    /// Plugin directory, searched before those that the profiles name; may be repeated.
    #[arg(long, value_name = "DIR")]
    pub plugins: Vec<PathBuf>,
    /// Journal of faults, starts and reloads: JSON lines, appended; no two daemons may share one
    /// [default: $XDG_STATE_HOME/framework-daemon/journal.jsonl].
    #[arg(long, value_name = "FILE")]
    pub journal: Option<PathBuf>,
    /// Begin anew: forget the checkpoints and the latched emergency stop that the run before may have left.
    #[arg(long)]
    pub fresh: bool,
    /// Where checkpoints lie, so that they outlive the daemon; on a tmpfs nothing ever waits for a disk
    /// [default: the journal's name with `.checkpoints` behind it].
    #[arg(long, value_name = "FILE")]
    pub checkpoints: Option<PathBuf>,
    /// Control socket for `status` and the other verbs that ask a running daemon; without this option the usual place, if
    /// it can be had [default: $XDG_RUNTIME_DIR/framework-daemon/control.sock, else /run/framework-daemon/control.sock].
    #[arg(long, value_name = "PATH")]
    pub socket: Option<PathBuf>,
    /// Provoke a fault that many seconds after `ready`, to see what is done about it; may be repeated.
    #[arg(long, value_name = "SLOT:SYMPTOM@SECONDS", value_parser = injection)]
    pub inject: Vec<Injection>,
}

/// Runs.
///
/// # Errors
/// Only those of writing.
pub fn run(arguments: Arguments, out: &mut impl Write) -> io::Result<Exit> {
    start_log();
    if let Ok(own) = std::env::current_exe() {
        probe::enable(own);
    }
    let Arguments { directory, plugins, journal, fresh, checkpoints, socket, inject } = arguments;
    let called = journal.unwrap_or_else(default_journal);
    // What belongs to it lies beside itself, not beside a link to it.
    let journal = place::canonical(&called);
    let checkpoints = checkpoints.unwrap_or_else(|| keep::beside(&journal));
    let settings = Settings { directory, plugins, journal, called, socket, checkpoints, fresh, injections: inject };
    abort_on_panic();
    let result = daemon::run(&settings, out);
    log_ring::flush(SHUTDOWN_STEP);
    let mut err = io::stderr();
    match result {
        Ok(Ending::Stopped) => Ok(Exit::Done),
        // The log said why; whoever supervises it sees a failure and starts it again.
        Ok(Ending::Restart(_)) => Ok(Exit::Failed),
        Err(RunError::Usage(reasons)) => tell(&reasons, &mut err).map(|()| Exit::Usage),
        Err(RunError::Profiles(diagnostics)) => {
            diagnostics.iter().try_for_each(|diagnostic| writeln!(err, "{diagnostic}"))?;
            Ok(Exit::ProfileInvalid)
        }
        Err(RunError::Plugins(reasons)) => tell(&reasons, &mut err).map(|()| Exit::PluginRefused),
        Err(RunError::Failed(reasons)) => tell(&reasons, &mut err).map(|()| Exit::Failed),
    }
}

fn tell(reasons: &[String], err: &mut impl Write) -> io::Result<()> {
    reasons.iter().try_for_each(|reason| writeln!(err, "{reason}"))
}

/// A panic of the daemon itself ends it, with its last words, instead of a thread that others wait for.
fn abort_on_panic() {
    std::panic::set_hook(Box::new(|info| {
        tracing::error!("the daemon itself panicked: {info}");
        log_ring::flush(PANIC_FLUSH);
        std::process::abort();
    }));
}

/// Log to stderr; `RUST_LOG` chooses what.
fn start_log() {
    let filter = tracing_subscriber::EnvFilter::try_from_default_env();
    let filter = filter.unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("info"));
    let ansi = io::IsTerminal::is_terminal(&io::stderr());
    let log = tracing_subscriber::fmt().with_env_filter(filter).with_writer(|| Lines).with_ansi(ansi);
    let log = log.with_target(false).log_internal_errors(false);
    // A second start in one process (tests) keeps the first.
    let _ = log.try_init();
}

fn default_journal() -> PathBuf {
    let from = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let state = from("XDG_STATE_HOME").or_else(|| from("HOME").map(|home| home.join(".local/state")));
    state.unwrap_or_else(std::env::temp_dir).join("framework-daemon/journal.jsonl")
}

/// `avoider:crash.segv@5`.
fn injection(text: &str) -> Result<Injection, String> {
    let parts = text.rsplit_once('@').and_then(|(front, seconds)| Some((front.split_once(':')?, seconds)));
    let ((slot, symptom), seconds) = parts.ok_or("write it as SLOT:SYMPTOM@SECONDS, as in avoider:crash.segv@5")?;
    let code = inject::code(symptom).ok_or_else(|| {
        let known: Vec<_> = INJECTIONS.iter().map(|(name, _)| *name).collect();
        format!("`{symptom}` cannot be provoked; these can: {}", known.join(", "))
    })?;
    let after = seconds.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    let after = after.ok_or_else(|| format!("`{seconds}` is no number of seconds"))?;
    Ok(Injection { slot: slot.to_owned(), code, after })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_injection_is_slot_symptom_and_seconds() {
        let parsed = injection("nav.avoider:crash.segv@1.5").unwrap();
        assert_eq!((parsed.slot.as_str(), parsed.code, parsed.after), ("nav.avoider", 2, Duration::from_millis(1500)));
    }

    #[test]
    fn the_help_names_all_that_can_be_provoked() {
        assert!(INJECTIONS.iter().all(|(name, _)| EXAMPLES.contains(name)), "{EXAMPLES}");
    }

    #[test]
    fn a_wrong_injection_names_the_way_out() {
        assert!(injection("avoider").unwrap_err().contains("SLOT:SYMPTOM@SECONDS"));
        assert!(injection("a:b@1").unwrap_err().contains("crash.panic"));
        assert!(injection("a:error@-1").unwrap_err().contains("no number of seconds"));
    }
}
