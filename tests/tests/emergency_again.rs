//! Who clears the emergency stop clears what he could know of: a raise that came after it stays, and is named.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crossbeam_channel::bounded;
use framework_daemon::exec::emergency;
use framework_daemon::fault::journal::Journal;
use framework_daemon::fault::manager::{self, Manager};
use framework_daemon::fault::order::{Obeyed, Order, Refused, Verb};
use framework_daemon::model::fault::{Evidence, Fault, FaultEvent, FaultSender, Outcome, Times, TrapEvidence};
use framework_daemon::model::ladder::Answer;
use framework_daemon::model::symptom::{Severity, Symptom};
use framework_daemon::profile::load;
use framework_daemon::supervise::boot::{boot, cast};
use framework_daemon::supervise::shutdown::shutdown;
use framework_daemon::sys::{clock, latch, trap};
use tests::brakes::{RULES, robot};
use tests::profiles::plugin_dir;

/// Far beyond what anything here needs.
const PATIENCE: Duration = Duration::from_secs(60);

struct House {
    manager: Manager,
    faults: FaultSender,
    journal: PathBuf,
}

/// The event of a fault that was answered by the emergency stop.
fn event(slot: &'static str, at_ns: u64) -> FaultEvent {
    FaultEvent {
        slot,
        class: "Witness",
        fault: Fault::told(Symptom::CrashSegv, at_ns, Evidence::Trap(TrapEvidence::new(libc::SIGSEGV, 0, 0))),
        severity: Severity::Emergency,
        answer: Answer::Emergency,
        successor: None,
        outcome: Outcome::Stopped,
        checkpoint_ns: None,
        cause: None,
        times: Times::default(),
    }
}

impl House {
    /// Raised, and its fault told that much later; never where there is no such time.
    fn raise(&self, slot: &'static str, told_after: Option<Duration>) {
        let at_ns = clock::now_ns();
        emergency::raise(slot, at_ns);
        let faults = self.faults.clone();
        std::thread::spawn(move || {
            if let Some(pause) = told_after {
                std::thread::sleep(pause);
                faults.send(event(slot, at_ns)).unwrap();
            }
        });
    }

    fn clear(&self) -> Obeyed {
        let (sender, answer) = bounded(1);
        let answer_to = Box::new(move |obeyed| sender.send(obeyed).unwrap());
        self.manager.outlook().order(Order { verb: Verb::Clear, slot: String::new(), answer: answer_to });
        answer.recv_timeout(PATIENCE).unwrap()
    }

    /// Raised, and known to all.
    fn raise_and_tell(&self, slot: &'static str) {
        let lines = || std::fs::read_to_string(&self.journal).unwrap().matches("\"raised\"").count();
        let before = lines();
        self.raise(slot, Some(Duration::ZERO));
        let began = Instant::now();
        while lines() == before {
            assert!(began.elapsed() < PATIENCE, "it is told");
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

fn refused(obeyed: Obeyed) -> String {
    match obeyed {
        Err(Refused::Latched(reason)) => reason,
        other => panic!("{other:?}"),
    }
}

// One test: there is one emergency stop for the process.
#[test]
fn a_raise_that_nobody_has_seen_is_not_cleared() {
    trap::install();
    let robot = robot(RULES, "");
    let journal = robot.lines.path().join("journal.jsonl");
    let (manager, faults) = manager::start(Arc::new(Mutex::new(Journal::open(&journal).unwrap()))).unwrap();
    let plan = load::load(robot.profiles.path()).unwrap().plan;
    let system = boot(Arc::new(plan), &[plugin_dir()], faults.clone()).unwrap();
    manager.adopt(cast(&system.plan, &system.slots, &system.helpers));
    let house = House { manager, faults, journal };
    let late = Some(Duration::from_millis(30));

    // Whoever clears it at once knows of the first raise, or it would not be latched.
    house.raise("sensor", late);
    assert_eq!(house.clear().unwrap()["cause"]["slot"], "sensor");
    assert!(!emergency::latched());

    // Of another one nobody knows who wants to clear the first.
    house.raise_and_tell("sensor");
    house.raise("idle", late);
    let reason = refused(house.clear());
    assert!(reason.contains("raised again at this moment, for crash.segv of idle (fault "), "{reason}");
    assert!(emergency::latched());
    let cleared = house.clear().unwrap();
    assert_eq!((&cleared["cause"]["slot"], &cleared["actuators"][1]["state"]), (&"sensor".into(), &"active".into()));
    assert!(!emergency::latched());

    // Once it was told of, it is cleared with the first.
    house.raise_and_tell("sensor");
    house.raise_and_tell("idle");
    assert!(house.clear().is_ok() && !emergency::latched());

    // One whose fault was lost on the way is told of as such, once.
    house.raise_and_tell("sensor");
    house.raise("idle", None);
    let reason = refused(house.clear());
    assert!(reason.contains("raised again at this moment"), "{reason}");
    assert!(house.clear().is_ok() && !emergency::latched());

    // What an older mark knows of is not what is latched now.
    house.raise_and_tell("sensor");
    let then = latch::mark().unwrap();
    house.raise_and_tell("idle");
    assert_eq!((latch::clear(then), emergency::latched()), (None, true));
    shutdown(system);
}
