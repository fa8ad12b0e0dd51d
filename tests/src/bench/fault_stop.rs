//! The fault-stop of a closure: from the fault of a slot until all that need it are stopped, by the fault manager over their
//! executors. The raw limit is a bare wake-up there and back for each wave of commands.

use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use component_sdk::abi::inject;
use framework_daemon::fault::feed::{Cursor, Feed, Next};
use framework_daemon::fault::journal::Journal;
use framework_daemon::fault::manager;
use framework_daemon::fault::order::{Order, Verb};
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::{self, boot};
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::sys::trap;

use super::limits;
use super::rig::PRIORITY;
use super::stats::Samples;
use crate::profiles::{Profiles, application, plugin_dir, slot};

/// Slots that need the one that fails.
pub const CLOSURE: usize = 1_000;
const PATIENCE: Duration = Duration::from_secs(20);

/// Who needs whom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Each needs the one before it, all on one executor.
    Chain,
    /// All need the first, on four executors.
    Star,
}

impl Shape {
    /// `chain of 1000`, `star of 1000`.
    #[must_use]
    pub fn name(self) -> String {
        let shape = if self == Self::Chain { "chain" } else { "star" };
        format!("{shape} of {CLOSURE}")
    }

    fn executor(self, number: usize) -> usize {
        if self == Self::Chain { 0 } else { number % 4 }
    }

    fn needed(self, number: usize) -> usize {
        if self == Self::Chain { number - 1 } else { 0 }
    }

    fn profiles(self, sched: &str) -> Profiles {
        let slots = (0..=CLOSURE).map(|number| {
            let executor = self.executor(number);
            slot(&format!("s{number}"), "Beat", &format!("<executor>e{executor}</executor>"))
        });
        let profiles = Profiles::new(&application(&slots.collect::<Vec<_>>(), &[]));
        let needs: String = (1..=CLOSURE)
            .map(|number| format!("<dependency component=\"s{number}\" on=\"s{}\"/>\n", self.needed(number)))
            .collect();
        profiles.replace("app.xml", "</application_profile>", &format!("{needs}</application_profile>"));
        // A thousand periods of 2 ms would be a load of their own.
        profiles.replace("Beat.xml", "<period>2ms</period>", "<period>20ms</period>");
        let policy = if sched == "fifo" { format!("policy=\"fifo\" priority=\"{PRIORITY}\"") } else { String::new() };
        let executors: String = (0..4).map(|number| format!("<executor name=\"e{number}\" {policy}/>")).collect();
        profiles.write("system.xml", &format!("<system_profile><name>bench</name>{executors}</system_profile>"));
        profiles
    }
}

/// `faults` fault-stops, each followed by a reset, and as many of the limit.
///
/// # Panics
/// When the system does not come up, or somebody is not stopped or does not return.
#[must_use]
pub fn measure(shape: Shape, sched: &str, faults: usize) -> (Samples, Samples) {
    trap::install();
    let profiles = shape.profiles(sched);
    let plan = Arc::new(load::load(profiles.path()).expect("the profile is valid").plan);
    let journal = Journal::open(&profiles.path().join("journal.jsonl")).expect("it can be written");
    let (manager, sender) = manager::start(Arc::new(Mutex::new(journal))).expect("a thread");
    let system = boot(plan, &[plugin_dir()], sender).expect("the components come up");
    manager.adopt(boot::cast(&system.plan, &system.slots, &system.helpers));
    let outlook = manager.outlook();
    let (mut own, mut raw) = (Samples::default(), Samples::default());
    let code = inject::code("crash.segv").expect("it can be provoked");
    for _ in 0..faults {
        let mut lines = Lines(outlook.feed(), outlook.feed().cursor(0, |_| true));
        let first = system.slot("s0").expect("it is there");
        assert_eq!(first.executor.inject(first.member, code, PATIENCE), Ok(true));
        let at_ns = lines.next("fault");
        own.add(lines.next("held") - at_ns);
        (1..CLOSURE).for_each(|_| _ = lines.next("held"));
        let (done, answer) = crossbeam_channel::bounded(1);
        let tell = move |obeyed: Result<serde_json::Value, _>| _ = done.send(obeyed.is_ok());
        outlook.order(Order { verb: Verb::Reset, slot: "s0".to_owned(), answer: Box::new(tell) });
        assert_eq!(answer.recv_timeout(PATIENCE), Ok(true));
        (0..CLOSURE).for_each(|_| _ = lines.next("returned"));
        raw.add(limits::wake(4, Duration::from_micros(200)).iter().take(2).sum());
    }
    manager.withdraw();
    shutdown(system);
    let _ = manager.finish(PATIENCE);
    (own, raw)
}

struct Lines<'a>(&'a Feed, Cursor);

impl Lines<'_> {
    /// When the next line of that kind was written.
    fn next(&mut self, kind: &str) -> u64 {
        let began = Instant::now();
        loop {
            match self.0.next(&mut self.1) {
                Some(Next::Line(line)) if line["kind"] == kind => return line["mono_ns"].as_u64().unwrap_or_default(),
                Some(Next::Line(_)) => {}
                Some(Next::Missed(count)) => panic!("{count} lines went by"),
                None => thread::sleep(Duration::from_micros(200)),
            }
            assert!(began.elapsed() < PATIENCE, "no line `{kind}`");
        }
    }
}
