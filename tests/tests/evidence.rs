//! What is told of a fault: where in the code, registers, whether memory is suspect, how everything is; and when the daemon
//! asks for a restart.

use serde_json::Value;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

const RESET: &str = "<fault_tolerance><severity>reset</severity></fault_tolerance>";

/// A slot that fails that way in its third cycle and whose second instance fails at once, beside one that does nothing.
fn doomed(hook: &str, how: &str) -> Profiles {
    let property = |name: &str, value: &str| format!("<property name=\"{name}\" type=\"string\">{value}</property>");
    let inside = format!("<properties>{}{}</properties>", property("hook", hook), property("how", how));
    let slots = [slot("diary", "Diary", RESET), slot("doomed", "Doomed", &inside)];
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles
}

fn first_fault(profiles: &Profiles, arguments: &[&str]) -> (Running, Value) {
    let daemon = Running::start(profiles.path(), arguments);
    let fault = daemon.journal("fault", 1).remove(0);
    (daemon, fault)
}

#[test]
fn a_trap_is_found_by_function_and_offset_in_its_plugin() {
    let (daemon, fault) = first_fault(&doomed("none", ""), &["--inject", "diary:crash.segv@0.1"]);
    let evidence = &fault["evidence"];
    assert_eq!(
        (evidence["function"].as_str(), evidence["module"].as_str()),
        (Some("component_sdk::abi::inject::segv"), Some("libbasic.so"))
    );
    assert!(evidence["offset"].as_u64().is_some() && evidence["module_offset"].as_u64() > Some(0), "{evidence}");
    let registers = evidence["registers"].as_object().unwrap();
    assert!(registers.len() >= 16 && registers.values().all(|value| value.as_str().unwrap().starts_with("0x")));
    // The place that is written to is in one of them.
    assert!(registers.values().any(|value| value == "0x8"), "{registers:?}");
    assert_eq!((fault["memory"].as_str(), fault["thread_lost"].as_bool()), (Some("sound"), Some(false)));
    daemon.wait_for("SIGSEGV at 0x8 in component_sdk::abi::inject::segv+0x");
}

#[test]
fn a_copy_from_nowhere_is_blamed_on_its_caller() {
    let (_daemon, fault) = first_fault(&doomed("execute", "copy"), &[]);
    let evidence = &fault["evidence"];
    assert!(evidence["module"].as_str().unwrap().starts_with("libc"), "{evidence}");
    assert!(evidence["caller"].as_str().unwrap().contains("libhostile.so"), "{evidence}");
    assert_eq!((fault["memory"].as_str(), fault["slot"].as_str()), (Some("sound"), Some("doomed")));
}

#[test]
fn a_wild_address_makes_memory_suspect() {
    let (mut daemon, fault) = first_fault(&doomed("execute", "wild"), &[]);
    assert_eq!(fault["memory"], "suspect");
    daemon.wait_for(", memory suspect");
    let slots = daemon.stop();
    assert_eq!((slots[0]["tainted"].as_u64(), slots[1]["tainted"].as_u64()), (Some(0), Some(1)));
    assert_eq!(daemon.entries("stop")[0]["process"]["tainted"], 1);
    daemon.wait_for("memory was suspect after 1 faults of this run");
}

#[test]
fn a_check_of_the_heap_makes_memory_suspect_and_an_abort_does_not() {
    let (_daemon, fault) = first_fault(&doomed("execute", "check"), &[]);
    assert_eq!(
        (fault["symptom"].as_str(), fault["memory"].as_str()),
        (Some("crash.abort"), Some("suspect")),
        "{fault}"
    );
    let (_daemon, fault) = first_fault(&doomed("none", ""), &["--inject", "diary:crash.abort@0.1"]);
    assert_eq!((fault["symptom"].as_str(), fault["memory"].as_str()), (Some("crash.abort"), Some("sound")));
    assert!(fault["evidence"]["caller"].as_str().unwrap().contains("libbasic.so"), "{fault}");
}

#[test]
fn a_profile_may_demand_a_restart_when_memory_is_suspect() {
    let profiles = doomed("execute", "wild");
    profiles.write("system.xml", "<system_profile on_taint=\"restart\"><name>s</name></system_profile>");
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(1));
    let restarts = daemon.entries("restart");
    assert!(restarts[0]["reason"].as_str().unwrap().contains("slot doomed (SIGSEGV)"), "{restarts:?}");
    assert_eq!(daemon.entries("stop").len(), 1, "it ends in order");
    daemon.wait_for("hook destroy");
    daemon.wait_for("asks its supervisor for a restart");
}

#[test]
fn an_ordinary_bug_asks_for_no_restart() {
    let profiles = doomed("execute", "segv");
    profiles.write("system.xml", "<system_profile on_taint=\"restart\"><name>s</name></system_profile>");
    let (mut daemon, _) = first_fault(&profiles, &[]);
    daemon.stop();
    assert!(daemon.entries("restart").is_empty());
}

#[test]
fn a_hang_is_blamed_on_the_function_that_waits() {
    let daemon = Running::start(stuck(1).path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    let evidence = &fault["evidence"];
    assert!(evidence["module"].as_str().unwrap().starts_with("libc"), "{evidence}");
    assert!(evidence["caller"].as_str().unwrap().starts_with("hostile::"), "{evidence}");
    assert_eq!((fault["symptom"].as_str(), fault["memory"].as_str()), (Some("hang"), Some("sound")));
}

/// So many slots that sleep for ever.
fn stuck(count: usize) -> Profiles {
    let rules = "<reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";
    let rules = RESET.replace("</fault_tolerance>", rules);
    let inside = format!("<properties><property name=\"how\" type=\"string\">sleep</property></properties>{rules}");
    let slots: Vec<String> = (0..count).map(|number| slot(&format!("stuck{number}"), "Stuck", &inside)).collect();
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    let semantics = "<execution_semantics>";
    profiles.replace("Stuck.xml", semantics, &format!("{semantics}<deadline hang=\"20ms\">10ms</deadline>"));
    profiles
}

#[test]
fn too_many_threads_that_were_given_up_ask_for_a_restart() {
    let profiles = stuck(16);
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(1));
    let restarts = daemon.entries("restart");
    assert!(restarts[0]["reason"].as_str().unwrap().contains("threads were given up"), "{restarts:?}");
    assert_eq!(daemon.lines("beyond it the daemon asks for a restart").len(), 1, "half of it is warned of");
    let stop = daemon.entries("stop").remove(0);
    assert!(stop["process"]["threads_lost"].as_u64() >= stop["process"]["threads_lost_max"].as_u64(), "{stop}");
}

#[test]
fn a_signal_asks_for_the_status() {
    let profiles = doomed("execute", "wild");
    let (mut daemon, _) = first_fault(&profiles, &[]);
    daemon.signal("USR1");
    let status = daemon.journal("status", 1).remove(0);
    let doomed = &status["slots"][1];
    assert_eq!((doomed["slot"].as_str(), doomed["state"].as_str()), (Some("doomed"), Some("error")));
    assert_eq!((doomed["quarantined"].as_u64(), doomed["tainted"].as_u64()), (Some(1), Some(1)));
    assert_eq!(
        (status["process"]["quarantined"].as_u64(), status["process"]["threads_lost"].as_u64()),
        (Some(1), Some(0))
    );
    assert!(status["process"]["threads_lost_max"].as_u64() > Some(0));
    // One spare is kept where a reset answers a crash.
    assert_eq!(
        (status["slots"][0]["spares"].as_u64(), status["slots"][0]["spares_wanted"].as_u64()),
        (Some(1), Some(1))
    );
    daemon.wait_for("threads given up: 0 of at most");
    assert!(daemon.is_alive());
}

#[test]
fn a_boot_that_fails_is_in_the_journal() {
    let profiles = doomed("initialize", "error");
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(1));
    let start = daemon.entries("start").remove(0);
    assert_eq!(start["accepted"], false);
    assert!(start["reasons"][0].as_str().unwrap().contains("slot doomed"), "{start}");
}

#[test]
fn a_signal_ends_a_boot_that_does_not_come_to_its_end() {
    for signal in ["TERM", "INT"] {
        let profiles = doomed("initialize", "sleep");
        let mut daemon = Running::spawn(profiles.path(), &[]);
        daemon.wait_for("hook initialize");
        daemon.signal(signal);
        assert_eq!(daemon.wait().code(), Some(0));
        let start = daemon.entries("start").remove(0);
        assert_eq!(start["reasons"][0], "it was told to end before it was ready");
    }
}
