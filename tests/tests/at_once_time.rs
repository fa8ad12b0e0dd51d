//! What is asked at once takes its time, too: others have their turn all the same, and it is counted for who took it.

use serde_json::Value;
use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

const RESET: &str =
    "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";
const IGNORE: &str = "<fault_tolerance><severity>ignore</severity></fault_tolerance>";

/// These slots on one executor.
fn profiles(slots: &[String], ends: &[&str]) -> Profiles {
    let connections: Vec<String> = ends.iter().map(|ends| connection_of("service", ends, "")).collect();
    let connections: Vec<&str> = connections.iter().map(String::as_str).collect();
    let profiles = Profiles::new(&application(slots, &connections));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.executors(&["main"]);
    profiles
}

/// A slot there, with a property and rules.
fn placed(name: &str, class: &str, property: &str, rules: &str) -> String {
    slot(name, class, &format!("{property}<executor>main</executor>{rules}"))
}

fn property(name: &str, kind: &str, value: &str) -> String {
    format!("<properties><property name=\"{name}\" type=\"{kind}\">{value}</property></properties>")
}

fn find<'a>(slots: &'a [Value], name: &str) -> &'a Value {
    slots.iter().find(|slot| slot["slot"] == name).unwrap()
}

#[test]
fn who_asks_for_much_lets_others_have_their_turn() {
    let slots = [placed("eager", "Eager", "", ""), placed("busy", "Busy", "", "")];
    let profiles = profiles(&slots, &["eager.ask -> busy.asked"]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("the server had its turn after");
    let _ = daemon.stop();
    let line = daemon.lines("the server had its turn after")[0].clone();
    let times: u32 = line.split_once('[').and_then(|(_, rest)| rest.split_once(']')).unwrap().0.parse().unwrap();
    // From its inbox it is about five: so often its executor looks at who was rung for before it looks at periods.
    assert!(times <= 20, "{line}");
}

#[test]
fn what_a_client_that_failed_asked_for_is_nobodys_time() {
    let slots = [
        placed("asker", "Asker", "", RESET),
        placed("overlong", "Overlong", "", IGNORE),
        placed("busy", "Busy", "", ""),
    ];
    let profiles = profiles(&slots, &["asker.ask -> busy.asked"]);
    let semantics = "<execution_semantics>";
    profiles.replace("Overlong.xml", semantics, &format!("{semantics}<deadline hang=\"2s\">10ms</deadline>"));
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for_lines("asked for work", 5);
    let slots = daemon.stop();
    let overlong = find(&slots, "overlong");
    assert!(overlong["cycles"].as_u64() > Some(0));
    assert_eq!(overlong["faults"], overlong["cycles"], "each was late: {overlong}");
    assert_eq!(find(&slots, "busy")["faults"], 0);
}

#[test]
fn what_is_asked_for_by_way_of_another_one_is_counted_once() {
    let slots = [
        placed("asker", "Asker", &property("works", "u64", "70"), ""),
        placed("between", "Busy", &property("passes", "bool", "true"), ""),
        placed("busy", "Busy", "", ""),
    ];
    let profiles = profiles(&slots, &["asker.ask -> between.asked", "between.onward -> busy.asked"]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("asked for work");
    let slots = daemon.stop();
    let asker = find(&slots, "asker");
    // To a tick of the kernel.
    assert!(asker["longest_ns"].as_u64() > Some(40_000_000), "{asker}");
}
