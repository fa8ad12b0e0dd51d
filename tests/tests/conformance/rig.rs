//! A daemon in which one component runs all cases of a pattern, once for each transport; the tests read what it logged.

use std::sync::OnceLock;

use tests::profiles::Profiles;
use tests::running::Running;

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
    let executors: String = ["main", "left", "right"].map(|name| format!("<executor name=\"{name}\"/>")).concat();
    profiles.write("system.xml", &format!("<system_profile><name>s</name>{executors}</system_profile>"));
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
