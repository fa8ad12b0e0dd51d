//! The fault manager's ports: components hear of faults, by a filter or of all, and report those of others.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

const RESET: &str =
    "<fault_tolerance><severity>reset</severity><reset limit=\"1000\" within=\"1s\"/></fault_tolerance>";

fn properties(properties: &[(&str, &str)]) -> String {
    let one = |(name, value): &(&str, &str)| format!("<property name=\"{name}\" type=\"string\">{value}</property>");
    format!("<properties>{}</properties>", properties.iter().map(one).collect::<String>())
}

/// A ticker and a diary that are reset, with one more slot, and connections of event ports.
fn profiles(more: &str, connections: &[&str]) -> Profiles {
    let slots = [slot("ticker", "Ticker", RESET), slot("diary", "Diary", RESET), more.to_owned()];
    let connections: Vec<String> = connections.iter().map(|ends| connection_of("event", ends, "")).collect();
    let connections: Vec<&str> = connections.iter().map(String::as_str).collect();
    let profiles = Profiles::new(&application(&slots, &connections));
    profiles.describe(&plugin_dir().join("libevents.so"));
    profiles
}

fn verb(arguments: &[&str], daemon: &Running) -> Output {
    Command::new(daemon_binary()).args(arguments).arg("--socket").arg(daemon.socket()).output().unwrap()
}

/// What a verb answers, an object a line.
fn asked(daemon: &Running, verb_and_more: &[&str]) -> Vec<Value> {
    let output = verb(&[verb_and_more, &["--format", "json"]].concat(), daemon);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn a_component_hears_of_the_faults_that_it_asked_for_and_another_of_all() {
    let filter = properties(&[("slot", "ticker"), ("symptom", "crash"), ("least", "reset")]);
    let listener = slot("listener", "FaultListener", &filter);
    let connections = ["fault_manager.faults -> listener.faults", "fault_manager.all_faults -> listener.all"];
    let inject = ["ticker:crash.segv@0.3", "diary:crash.panic@0.4", "ticker:error@0.5", "ticker:crash.panic@0.6"];
    let inject: Vec<&str> = inject.iter().flat_map(|fault| ["--inject", fault]).collect();
    let mut daemon = Running::start(profiles(&listener, &connections).path(), &inject);
    let faults = daemon.journal("fault", 4);
    daemon.wait_for_lines("hears: ", 4);
    daemon.wait_for_lines("asked for: ", 2);
    daemon.stop();
    let told = daemon.lines("asked for: ");
    assert_eq!(told.len(), 2, "{told:?}");
    let sequence = |fault: &Value| fault["seq"].as_u64().unwrap();
    let first = format!("asked for: {} ticker crash.segv reset recovered: SIGSEGV", sequence(&faults[0]));
    assert!(told[0].contains(&first), "{first} in {told:?}");
    assert!(told[1].contains(&format!("asked for: {} ticker crash.panic", sequence(&faults[3]))), "{told:?}");
    for (line, fault) in daemon.lines("hears: ").iter().zip(&faults) {
        let text = |name: &str| fault[name].as_str().unwrap();
        assert!(line.contains(&format!("hears: {} {} {}", sequence(fault), text("slot"), text("symptom"))), "{line}");
    }
}

#[test]
fn a_component_reports_another_slot_which_answers_by_its_own_rules() {
    let reporter = slot("reporter", "FaultReporter", &properties(&[("blames", "ticker")]));
    let mut daemon = Running::start(profiles(&reporter, &["reporter.report -> fault_manager.report"]).path(), &[]);
    let fault = daemon.journal("fault", 1).remove(0);
    let text = |name: &str| fault[name].as_str().unwrap();
    assert_eq!(
        [text("slot"), text("symptom"), text("action"), text("outcome")],
        ["ticker", "raised", "reset", "recovered"]
    );
    assert_eq!(fault["evidence"]["message"], "reporter reports: it looks the wrong way");
    let slots = daemon.stop();
    let faults = |name: &str| slots.iter().find(|slot| slot["slot"] == name).unwrap()["faults"].as_u64();
    assert_eq!((faults("ticker"), faults("reporter")), (Some(1), Some(0)));
}

#[test]
fn a_report_without_a_name_is_of_who_reports_and_one_of_nobody_is_told() {
    let own = slot("reporter", "FaultReporter", "");
    let mut daemon = Running::start(profiles(&own, &["reporter.report -> fault_manager.report"]).path(), &[]);
    assert_eq!(daemon.journal("fault", 1)[0]["slot"], "reporter");
    daemon.stop();
    let nobody = slot("reporter", "FaultReporter", &properties(&[("blames", "nobody")]));
    let mut daemon = Running::start(profiles(&nobody, &["reporter.report -> fault_manager.report"]).path(), &[]);
    daemon.wait_for("slot reporter reports a fault of `nobody`, and there is no such slot");
    daemon.stop();
    assert!(daemon.entries("fault").is_empty());
}

#[test]
fn its_ports_are_connected_and_shown_at_run_time_as_any_others() {
    let listener = slot("listener", "FaultListener", "");
    let mut daemon = Running::start(profiles(&listener, &[]).path(), &["--inject", "ticker:crash.panic@1.5"]);
    daemon.wait_for("does not ask");
    let connected = verb(&["connect", "fault_manager.all_faults", "listener.all"], &daemon);
    assert!(connected.status.success(), "{}", String::from_utf8_lossy(&connected.stderr));
    let ports = asked(&daemon, &["port", "list", "fault_manager"]);
    let names: Vec<_> = ports.iter().map(|port| port["port"].as_str().unwrap().to_owned()).collect();
    assert!(["faults", "all_faults", "report"].iter().all(|name| names.iter().any(|known| known == name)), "{names:?}");
    let all = &asked(&daemon, &["port", "info", "fault_manager.all_faults"])[0];
    assert_eq!(all["port"]["connections"], serde_json::json!(["listener.all"]));
    let heard = &asked(&daemon, &["port", "info", "listener.all"])[0];
    assert_eq!(heard["port"]["connections"], serde_json::json!(["fault_manager.all_faults"]));
    daemon.wait_for("ticker crash.panic");
    daemon.wait_for_lines("hears: ", 1);
    daemon.stop();
}

#[test]
fn a_slow_subscriber_loses_notices_which_are_counted_and_nobody_waits_for_it() {
    let slow = format!("<properties><property name=\"slow\" type=\"int\">{}</property></properties>", 60_000);
    let listener = slot("listener", "FaultListener", &slow);
    let faults: Vec<String> =
        (0..40).map(|number| format!("ticker:error@{:.3}", 0.2 + 0.01 * f64::from(number))).collect();
    let inject: Vec<&str> = faults.iter().flat_map(|fault| ["--inject", fault]).collect();
    let mut daemon = Running::start(profiles(&listener, &["fault_manager.all_faults -> listener.all"]).path(), &inject);
    let _ = daemon.journal("fault", 40);
    let port = &asked(&daemon, &["port", "info", "listener.all"])[0];
    assert!(port["port"]["dropped"].as_u64() > Some(10), "{port}");
    daemon.stop();
}

fn check(directory: &Path) -> String {
    let output = Command::new(daemon_binary()).arg("check").arg(directory).arg("--plugins").arg(plugin_dir()).output();
    let output = output.unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stdout));
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

#[test]
fn its_name_is_taken_and_its_ports_are_known() {
    let listener = slot("listener", "FaultListener", "");
    let wrong = check(profiles(&listener, &["fault_manager.fault -> listener.faults"]).path());
    assert!(wrong.contains("fault_manager has no event port \"fault\"") && wrong.contains("faults"), "{wrong}");
    let reversed = check(profiles(&listener, &["listener.all -> fault_manager.all_faults"]).path());
    assert!(reversed.contains("reversed"), "{reversed}");
    let taken = check(profiles(&slot("fault_manager", "FaultListener", ""), &[]).path());
    assert!(taken.contains("\"fault_manager\" is the fault manager's own name"), "{taken}");
}
