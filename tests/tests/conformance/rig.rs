//! A daemon in which one component runs all cases of a pattern, once for each transport; the tests read what it logged.

use std::sync::OnceLock;
use std::time::Duration;

use tests::profiles::Profiles;
use tests::running::Running;

/// Faults are answered by a reset, as often as they come.
pub(crate) const RESET: &str =
    "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";

/// How the two sides are brought together.
#[derive(Clone, Copy)]
pub(crate) enum Transport {
    /// On one executor.
    Near,
    /// On two.
    Far,
}

impl Transport {
    /// The executor of a slot of that side, `left` or `right`; the system profile declares them, and `main`.
    pub(crate) fn place(self, side: &str) -> String {
        let executor = match self {
            Self::Near => "main",
            Self::Far => side,
        };
        format!("<executor>{executor}</executor>")
    }
}

/// The system profile with the executors of both sides.
pub(crate) fn declare_executors(profiles: &Profiles) {
    profiles.executors(&["main", "left", "right"]);
}

/// A daemon in which a component is in the middle of a wait for what does not come.
pub(crate) fn parked(profiles: Profiles) -> (Profiles, Running) {
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for(": waits");
    // Into the middle of the wait.
    std::thread::sleep(Duration::from_millis(50));
    (profiles, daemon)
}

/// Stops it: the wait is told so, and nobody is to blame.
///
/// # Panics
/// Where it is otherwise.
pub(crate) fn is_stopped_while_parked(daemon: &mut Running) {
    let slots = daemon.stop();
    let log = daemon.log();
    assert!(log.contains("waited: Err(Cancelled)") || log.contains("waited: Err(ProviderStopped)"), "{log}");
    assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
}

/// A reload builds that class anew: the wait is told so, and the new instance waits again.
///
/// # Panics
/// Where it is otherwise.
pub(crate) fn is_built_anew_while_parked(profiles: Profiles, class: &str) {
    let (profiles, mut daemon) = parked(profiles);
    profiles.replace(&format!("{class}.xml"), "<version>1.0</version>", "<version>1.1</version>");
    daemon.signal("HUP");
    daemon.wait_for("waited: Err(Cancelled)");
    daemon.wait_for_lines(": waits", 2);
    let slots = daemon.stop();
    assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
}

/// The cases of one pattern, on each transport: each run once, in a daemon of its own, when the first test asks.
pub(crate) struct Suite {
    profiles: fn(Transport) -> Profiles,
    logs: [OnceLock<String>; 2],
}

impl Suite {
    /// The cases that a daemon runs with these profiles.
    pub(crate) const fn new(profiles: fn(Transport) -> Profiles) -> Self {
        Self { profiles, logs: [const { OnceLock::new() }; 2] }
    }

    /// The log of a daemon that has run all cases.
    fn log(&self, transport: Transport) -> &str {
        self.logs[transport as usize].get_or_init(|| {
            let profiles = (self.profiles)(transport);
            let mut daemon = Running::start(profiles.path(), &[]);
            daemon.wait_for("all cases are done");
            daemon.stop();
            daemon.log()
        })
    }

    /// How a case went.
    pub(crate) fn passes(&self, transport: Transport, case: &str) {
        let line = format!("case {case}: ");
        let log = self.log(transport);
        let found =
            log.lines().find(|found| found.contains(&line)).unwrap_or_else(|| panic!("{case} did not run:\n{log}"));
        assert!(found.ends_with(": ok"), "{found}");
    }
}

/// Makes each name a test of each transport.
macro_rules! conformance {
    ($suite:ident; $($name:ident),+ $(,)?) => {
        mod near {
            $(#[test] fn $name() { super::$suite.passes(crate::rig::Transport::Near, stringify!($name)); })+
        }
        mod far {
            $(#[test] fn $name() { super::$suite.passes(crate::rig::Transport::Far, stringify!($name)); })+
        }
    };
}

pub(crate) use conformance;
