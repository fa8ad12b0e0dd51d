//! Callbacks that do not return, or that trap where a lock may be held: ended, blamed, answered; their neighbours on the same
//! executor go on.

use serde_json::Value;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

const RULES: &str = "<executor>main</executor><fault_tolerance><severity>reset</severity>\
                     <reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";

/// A component that sticks in that way, and one beside it on the same executor.
fn stuck(how: &str) -> Profiles {
    let how = format!("<properties><property name=\"how\" type=\"string\">{how}</property></properties>{RULES}");
    let neighbour = slot("neighbour", "Ticker", "<executor>main</executor>");
    let profiles = Profiles::new(&application(&[slot("stuck", "Stuck", &how), neighbour], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.executors(&["main"]);
    let semantics = "<execution_semantics>";
    profiles.replace("Stuck.xml", semantics, &format!("{semantics}<deadline hang=\"20ms\">10ms</deadline>"));
    profiles
}

/// The first faults of a component that sticks in that way; the daemon and the neighbour are well afterwards.
fn faults(how: &str, count: usize) -> Vec<Value> {
    let profiles = stuck(how);
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", count);
    let slots = daemon.stop();
    let neighbour = slots.iter().find(|slot| slot["slot"] == "neighbour").unwrap();
    assert_eq!((neighbour["faults"].as_u64(), neighbour["state"].as_str()), (Some(0), Some("active")), "{how}");
    assert!(neighbour["cycles"].as_u64() > Some(0));
    assert!(faults.iter().all(|fault| fault["slot"] == "stuck"), "{how}");
    faults
}

#[test]
fn every_way_to_hang_is_ended_and_answered() {
    for how in ["spin", "sleep", "malloc", "lock", "read"] {
        for fault in faults(how, 5) {
            assert_eq!(
                (fault["symptom"].as_str(), fault["outcome"].as_str()),
                (Some("hang"), Some("recovered")),
                "{how}"
            );
        }
    }
}

#[test]
fn late_is_not_never() {
    let faults = faults("slow", 3);
    assert!(faults.iter().all(|fault| fault["symptom"] == "overrun" && fault["outcome"] == "recovered"));
    let evidence = &faults[0]["evidence"];
    assert!(evidence["took_ns"].as_u64() > evidence["budget_ns"].as_u64(), "{evidence}");
}

#[test]
fn a_bad_pointer_given_to_the_c_library_costs_no_thread() {
    for fault in faults("memcpy", 5) {
        assert_eq!((fault["symptom"].as_str(), fault["thread_lost"].as_bool()), (Some("crash.segv"), Some(false)));
    }
}

#[test]
fn memory_that_is_freed_twice_costs_no_thread() {
    for fault in faults("free", 5) {
        assert_eq!((fault["symptom"].as_str(), fault["thread_lost"].as_bool()), (Some("crash.abort"), Some(false)));
    }
}

#[test]
fn a_heap_that_the_c_library_finds_corrupt_costs_a_thread_and_nothing_else() {
    for fault in faults("corrupt", 5) {
        assert_eq!((fault["symptom"].as_str(), fault["thread_lost"].as_bool()), (Some("crash.abort"), Some(true)));
        assert_eq!(fault["outcome"], "recovered");
    }
}
