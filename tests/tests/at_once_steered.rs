//! Slots are stopped, started and cut off, and fail, in the middle of questions that are answered at once, or not: each answer is
//! the right one, nobody but who failed is blamed, and all goes on afterwards.

use tests::asking::ask;
use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

const RULES: &str =
    "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";
const ROUNDS: usize = 8;

/// Orders that interrupt, and those that put right what they did.
const ORDERS: [(&str, &str); 4] = [
    ("component stop moody", "component start moody"),
    ("component stop insistent", "component start insistent"),
    ("disconnect insistent.ask", "connect insistent.ask moody.asked"),
    ("reload", "reload"),
];

fn profiles(executor: &str) -> Profiles {
    let placed = |name, class, executor| slot(name, class, &format!("<executor>{executor}</executor>{RULES}"));
    let slots = [placed("insistent", "Insistent", "main"), placed("moody", "Moody", executor)];
    let profiles =
        Profiles::new(&application(&slots, &[&connection_of("service", "insistent.ask -> moody.asked", "")]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.executors(&["main", "other"]);
    profiles
}

fn order(daemon: &Running, verb: &str) {
    let answer = ask(daemon, verb);
    assert_eq!(answer.code, Some(0), "{verb}: {}", answer.err);
}

fn goes_on(executor: &str) {
    let profiles = profiles(executor);
    let mut daemon = Running::start(profiles.path(), &[]);
    for round in 0..ROUNDS {
        for (interrupt, repair) in ORDERS {
            order(&daemon, interrupt);
            order(&daemon, repair);
        }
        daemon.wait_for_lines("two thousand answers", 2 * (round + 1));
    }
    let before = daemon.lines("two thousand answers").len();
    daemon.wait_for_lines("two thousand answers", before + 10);
    let slots = daemon.stop();
    assert!(slots.iter().all(|slot| slot["state"] == "active"), "{slots:?}");
    let faults = daemon.entries("fault");
    assert!(!faults.is_empty());
    for fault in faults {
        let symptom = fault["symptom"].as_str().unwrap_or_default();
        assert!(fault["slot"] == "moody" && ["crash.segv", "crash.panic"].contains(&symptom), "{fault}");
    }
}

#[test]
fn questions_are_answered_at_once_between_all_orders() {
    goes_on("main");
}

#[test]
fn questions_are_answered_from_another_executor_between_all_orders() {
    goes_on("other");
}
