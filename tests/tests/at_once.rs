//! A server that shares its client's executor is asked at once, in the middle of the client's callback. Whatever its handler
//! does there, the client sees the same as from another executor, and is blamed for nothing.

use serde_json::Value;
use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

/// What a client is told, and the faults, in order: who, and by which symptom.
const TOLD: [&str; 15] = [
    "asked to panic: Ok(0), Err(Error)",
    "asked to segv: Ok(0), Err(ProviderGone)",
    "asked to check: Ok(0), Err(ProviderGone)",
    "asked to spin: Ok(0), Err(ProviderGone)",
    "asked to error: Ok(0), Err(Error)",
    "asked to raise, answer: Ok(0), Ok(6)",
    "asked to answer, segv: Ok(0), Ok(7)",
    "asked to answer, panic: Ok(0), Ok(8)",
    "asked to answer later: Ok(0), Ok(9)",
    "asked to sleep, answer: Ok(0), Ok(10)",
    // The code of `ProviderGone`.
    "asked to ask one that traps: Ok(0), Ok(1024)",
    // That of `Cycle`.
    "asked to ask back: Ok(0), Ok(1027)",
    "asked to answer from a task: Ok(0), Ok(13)",
    "asked to forget: Ok(0), Err(Error)",
    "asked to exit: Ok(0), Err(ProviderGone)",
];
const FAULTS: [(&str, &str); 10] = [
    ("fragile", "crash.panic"),
    ("fragile", "crash.segv"),
    ("fragile", "crash.abort"),
    ("fragile", "hang"),
    ("fragile", "error"),
    ("fragile", "raised"),
    ("fragile", "crash.segv"),
    ("fragile", "crash.panic"),
    ("deep", "crash.segv"),
    ("fragile", "crash.exit"),
];

/// The prober on the executor `main`, what it asks on that one, and a neighbour there.
fn probed(executor: &str) -> Profiles {
    let rules = |executor: &str| {
        format!(
            "<executor>{executor}</executor><fault_tolerance><severity>reset</severity>\
             <reset limit=\"1000\" within=\"1s\"/></fault_tolerance>"
        )
    };
    let slots = [
        slot("prober", "Prober", &rules("main")),
        slot("fragile", "Fragile", &rules(executor)),
        slot("deep", "Fragile", &rules(executor)),
        slot("neighbour", "Ticker", &rules("main")),
    ];
    let connection = |ends| connection_of("service", ends, "");
    let ends = ["prober.ask -> fragile.asked", "fragile.onward -> deep.asked", "fragile.back -> prober.asked"];
    let connections = ends.map(connection);
    let profiles = Profiles::new(&application(&slots, &connections.each_ref().map(String::as_str)));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.executors(&["main", "other"]);
    profiles
}

fn sees_the_same(executor: &str) {
    let profiles = probed(executor);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("others had their turn");
    let faults = daemon.journal("fault", FAULTS.len());
    let slots = daemon.stop();
    let told: Vec<String> = daemon.lines("asked to ");
    for (line, expected) in told.iter().zip(TOLD) {
        // Of two that close a ring from two executors either may be told.
        let is_other_end = executor != "main" && line.contains("asked to ask back: Ok(0), Err(Cycle)");
        assert!(line.contains(expected) || is_other_end, "{line}, not {expected}");
    }
    assert_eq!(told.len(), TOLD.len());
    let text = |fault: &Value, what: &str| fault[what].as_str().unwrap_or_default().to_owned();
    let seen: Vec<_> = faults.iter().map(|fault| (text(fault, "slot"), text(fault, "symptom"))).collect();
    assert_eq!(seen, FAULTS.map(|(slot, symptom)| (slot.to_owned(), symptom.to_owned())));
    assert!(faults.iter().all(|fault| fault["outcome"] == "recovered"), "{faults:?}");
    for name in ["prober", "neighbour"] {
        let slot = slots.iter().find(|slot| slot["slot"] == name).unwrap();
        assert_eq!((slot["faults"].as_u64(), slot["state"].as_str()), (Some(0), Some("active")), "{name}");
    }
}

#[test]
fn whatever_a_handler_does_its_client_sees_the_same_at_once() {
    sees_the_same("main");
}

#[test]
fn and_from_another_executor() {
    sees_the_same("other");
}
