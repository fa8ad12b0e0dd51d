//! A daemon in which an asker runs all cases against a teller, once for each transport; the tests read what it logged.

use std::sync::OnceLock;

use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
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
    /// What belongs into a slot of that side.
    fn place(self, side: &str) -> String {
        let executor = match self {
            Self::Near => "main",
            Self::Far => side,
        };
        format!("<executor>{executor}</executor>")
    }

    /// The log of a daemon that has run all cases.
    pub(crate) fn log(self) -> &'static str {
        static LOGS: [OnceLock<String>; 2] = [const { OnceLock::new() }; 2];
        LOGS[self as usize].get_or_init(|| {
            let profiles = profiles(self, "all");
            let mut daemon = Running::start(profiles.path(), &[]);
            daemon.wait_for("all cases are done");
            daemon.stop();
            daemon.log()
        })
    }

    /// How a case went.
    pub(crate) fn passes(self, case: &str) {
        let line = format!("case {case}: ");
        let log = self.log();
        let found =
            log.lines().find(|found| found.contains(&line)).unwrap_or_else(|| panic!("{case} did not run:\n{log}"));
        assert!(found.ends_with(": ok"), "{found}");
    }
}

const RULES: &str =
    "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";

/// Asker, teller and a third one.
pub(crate) fn profiles(transport: Transport, run: &str) -> Profiles {
    let cases = format!("<properties><property name=\"run\" type=\"string\">{run}</property></properties>");
    let slots = [
        slot("asker", "Asker", &format!("{cases}{}", transport.place("left"))),
        slot("teller", "Teller", &format!("{}{RULES}", transport.place("right"))),
        slot("echo", "Echo", &transport.place("right")),
    ];
    let links = [
        connection_of("service", "asker.tell -> teller.told", ""),
        connection_of("service", "asker.again -> teller.told", "<on_gone>retry</on_gone>"),
        connection_of("service", "asker.own -> asker.answers", ""),
        connection_of("service", "teller.onward -> echo.told", ""),
        connection_of("service", "teller.back -> asker.answers", ""),
    ];
    let text =
        application(&slots, &[]).replace("</port_connections>", &format!("{}</port_connections>", links.concat()));
    let profiles = Profiles::new(&text);
    profiles.describe(&plugin_dir().join("libqueries.so"));
    let executors: String = ["main", "left", "right"].map(|name| format!("<executor name=\"{name}\"/>")).concat();
    profiles.write("system.xml", &format!("<system_profile><name>s</name>{executors}</system_profile>"));
    let asker = std::fs::read_to_string(profiles.path().join("Asker.xml")).expect("described");
    // The second required port times out soon.
    let (before, after) = asker.split_once("<name>again</name>").expect("the port is described");
    let after = after.replacen("<timeout>1s</timeout>", "<timeout>100ms</timeout>", 1);
    profiles.write("Asker.xml", &format!("{before}<name>again</name>{after}"));
    let semantics = "<execution_semantics>";
    profiles.replace("Teller.xml", semantics, &format!("{semantics}<deadline hang=\"100ms\">50ms</deadline>"));
    profiles
}

/// Makes each name a test of that transport, and of the other.
macro_rules! conformance {
    ($($name:ident),+ $(,)?) => {
        mod near {
            $(#[test] fn $name() { crate::rig::Transport::Near.passes(stringify!($name)); })+
        }
        mod far {
            $(#[test] fn $name() { crate::rig::Transport::Far.passes(stringify!($name)); })+
        }
    };
}

pub(crate) use conformance;
