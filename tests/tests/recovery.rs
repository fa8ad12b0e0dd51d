//! What stands ready: spares, and what becomes of them.

use tests::profiles::{Profiles, application, connection, connection_of, plugin_dir, slot};
use tests::running::Running;

/// One slot of the class that counts its instances, with these properties and rules.
fn heirs(properties: &[(&str, &str)], rules: &str) -> Profiles {
    let property = |(name, text): &(&str, &str)| format!("<property name=\"{name}\" type=\"string\">{text}</property>");
    let properties: String = properties.iter().map(property).collect();
    let inside = format!(
        "<properties>{properties}</properties><fault_tolerance><severity>reset</severity>{rules}</fault_tolerance>"
    );
    let profiles = Profiles::new(&application(&[slot("heir", "Heir", &inside)], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles
}

/// The numbers in the log's lines `heir N <word>`.
fn numbers(daemon: &Running, word: &str) -> Vec<u64> {
    let number = |line: &String| line.split("heir ").nth(1)?.strip_suffix(word)?.trim().parse().ok();
    daemon.lines(word).iter().filter_map(number).collect()
}

#[test]
fn spares_are_ready_before_the_first_fault_used_in_turn_and_made_anew() {
    let profiles = heirs(&[("from", "100"), ("until", "100")], "<spare count=\"2\"/>");
    let inject: Vec<String> = (2..6).flat_map(|at| ["--inject".into(), format!("heir:crash.segv@0.{at}")]).collect();
    let mut daemon = Running::start(profiles.path(), &inject.iter().map(String::as_str).collect::<Vec<_>>());
    daemon.wait_for_lines("is ready", 7);
    assert!(daemon.journal("fault", 4).iter().all(|fault| fault["outcome"] == "recovered"));
    let slots = daemon.stop();
    assert_eq!(numbers(&daemon, "succeeds"), [2, 3, 4, 5], "each in its turn, none made on the spot");
    assert_eq!(slots[0]["quarantined"], 4);
    let mut ended = numbers(&daemon, "ends");
    ended.sort_unstable();
    assert_eq!(ended, [5, 6, 7], "the spares that were left end in order");
}

#[test]
fn what_stands_ready_has_rehearsed_and_nobody_heard_it() {
    let rules = "<reset limit=\"0\"/><spare/><secondary reference=\"Heir.xml\"/>";
    let profiles = heirs(&[("from", "100"), ("until", "100")], rules);
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("gauge", "Gauge", "")));
    let wire = connection("heir.said -> gauge.heard", "<validity field=\"range\"><min>0</min></validity>");
    profiles.replace("app.xml", "</port_connections>", &format!("{wire}</port_connections>"));
    let mut daemon = Running::start(profiles.path(), &["--inject", "heir:crash.segv@0.2"]);
    let fault = daemon.journal("fault", 1).remove(0);
    assert_eq!((fault["action"].as_str(), fault["outcome"].as_str()), (Some("replace"), Some("recovered")));
    daemon.wait_for("heir 4 rehearses");
    daemon.stop();
    assert_eq!(daemon.entries("fault").len(), 1, "a rehearsal's values reach nobody");
    // The secondary, the primary's spare, and then the secondary's; the primary does not.
    let mut rehearsed = numbers(&daemon, "rehearses: Unconnected");
    rehearsed.sort_unstable();
    assert_eq!((rehearsed, numbers(&daemon, "succeeds")), (vec![2, 3, 4], vec![2]));
}

#[test]
fn one_spare_is_kept_where_a_reset_answers_a_crash_and_none_where_nothing_does() {
    let daemon = Running::start(heirs(&[("from", "100"), ("until", "100")], "").path(), &[]);
    daemon.wait_for_lines("is ready", 2);
    let profiles = heirs(&[("from", "100"), ("until", "100")], "");
    profiles.replace("app.xml", "<severity>reset</severity>", "");
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.stop();
    assert_eq!(numbers(&daemon, "is ready"), [1]);
}

#[test]
fn a_spare_that_cannot_be_made_is_journaled_and_tried_again_and_the_slot_works_on() {
    for how in ["panic", "segv", "error"] {
        let profiles = heirs(&[("how", how)], "<spare count=\"1\"/>");
        let mut daemon = Running::start(profiles.path(), &["--inject", "heir:crash.segv@0.6"]);
        let faults = daemon.journal("fault", 3);
        let field =
            |name: &str| faults.iter().map(|fault| fault[name].as_str().unwrap_or_default()).collect::<Vec<_>>();
        assert_eq!(field("action"), ["prepare", "prepare", "reset"], "{how}");
        assert_eq!(field("outcome"), ["failed", "failed", "recovered"], "{how}");
        daemon.wait_for("heir 4 succeeds");
        let slots = daemon.stop();
        assert_eq!((slots[0]["state"].as_str(), slots[0]["faults"].as_u64()), (Some("active"), Some(3)), "{how}");
    }
}

/// A slot whose secondaries all fail in `start`, so that each try of its recovery does.
fn hopeless() -> Profiles {
    let property = |name, text| format!("<property name=\"{name}\" type=\"string\">{text}</property>");
    let properties = format!("<properties>{}{}</properties>", property("hook", "start"), property("how", "segv"));
    let secondaries = "<secondary reference=\"Doomed.xml\" preload=\"library\"/>".repeat(12);
    let rules = format!("<fault_tolerance><severity>reset</severity>{secondaries}</fault_tolerance>");
    let profiles = Profiles::new(&application(&[slot("hopeless", "Doomed", &(properties + &rules))], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles
}

#[test]
fn a_stop_wins_over_a_recovery_that_breathes() {
    let profiles = hopeless();
    let mut daemon = Running::start(profiles.path(), &[]);
    // By now the pauses are longer than what a stop takes.
    let failed = daemon.journal("fault", 6);
    assert!(failed.iter().all(|fault| fault["outcome"] == "failed"));
    let slots = daemon.stop();
    let faults = daemon.entries("fault");
    let last = faults.last().unwrap();
    assert_eq!((last["symptom"].as_str(), last["outcome"].as_str()), (Some("crash.segv"), Some("stopped")));
    assert!(faults.len() < 14, "it did not try all that was left: {}", faults.len());
    assert_eq!(slots[0]["state"], "error");
}

#[test]
fn a_slot_that_stopped_keeps_no_spares() {
    let profiles = heirs(&[("from", "100"), ("until", "100")], "<reset limit=\"1\"/><spare count=\"2\"/>");
    let inject = ["--inject", "heir:crash.segv@0.2", "--inject", "heir:crash.segv@0.4"];
    let mut daemon = Running::start(profiles.path(), &inject);
    let faults = daemon.journal("fault", 2);
    assert_eq!(faults[1]["outcome"], "stopped");
    daemon.wait_for_lines("ends", 2);
    daemon.stop();
    assert_eq!(numbers(&daemon, "ends").len(), numbers(&daemon, "is ready").len() - 2);
}

/// A slot that keeps numbers, with a checkpoint or without.
fn keeper(properties: &str, rules: &str) -> Profiles {
    let rules = format!(
        "<properties>{properties}</properties><fault_tolerance><severity>reset</severity>{rules}</fault_tolerance>"
    );
    let profiles = Profiles::new(&application(&[slot("keeper", "Keeper", &rules)], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles
}

/// Where each instance went on from: the number outside it and the one inside.
fn starts(daemon: &Running) -> Vec<(u64, u64)> {
    let numbers = |line: &String| {
        let (outside, inside) = line.split("goes on from ").nth(1)?.split_once(" and ")?;
        Some((outside.parse().ok()?, inside.parse().ok()?))
    };
    daemon.lines("keeper goes on from").iter().filter_map(numbers).collect()
}

#[test]
fn a_successor_goes_on_from_the_last_checkpoint() {
    let secondary = "<reset limit=\"1\"/><secondary reference=\"Keeper.xml\"/><checkpoint period=\"10ms\"/>";
    let inject = ["--inject", "keeper:crash.segv@0.3", "--inject", "keeper:crash.segv@0.5"];
    let mut daemon = Running::start(keeper("", secondary).path(), &inject);
    let faults = daemon.journal("fault", 2);
    assert!(faults.iter().all(|fault| fault["outcome"] == "recovered"));
    assert!(faults.iter().all(|fault| fault["checkpoint"].as_u64() > Some(0)), "its age is told: {faults:?}");
    daemon.wait_for_lines("keeper goes on from", 3);
    daemon.stop();
    let starts = starts(&daemon);
    assert_eq!(starts[0], (0, 0));
    // 300 ms are 150 cycles, of which at most one checkpoint's are lost.
    assert!(starts[1].0 > 50 && starts[2].0 > starts[1].0, "{starts:?}");
    assert!(starts.iter().all(|(outside, inside)| outside == inside), "both are of one moment: {starts:?}");
}

/// What a ledger without a callback of its own goes on from, of a hundred, where its client is on the executor `main`.
fn ledger_goes_on_from(executor: &str) -> u64 {
    let reset = "<severity>reset</severity><reset limit=\"1\"/><checkpoint period=\"1ms\"/>";
    let rules = format!("<executor>{executor}</executor><fault_tolerance>{reset}</fault_tolerance>");
    let slots = [slot("ledger", "Ledger", &rules), slot("depositor", "Depositor", "<executor>main</executor>")];
    let connection = connection_of("service", "depositor.ask -> ledger.asked", "");
    let profiles = Profiles::new(&application(&slots, &[&connection]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.executors(&["main", "other"]);
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("the ledger goes on from [");
    let line = daemon.lines("the ledger goes on from [").remove(0);
    line.split_once('[').and_then(|(_, rest)| rest.split_once(']')).unwrap().0.parse().unwrap()
}

#[test]
fn what_handlers_change_is_in_the_checkpoint() {
    for executor in ["main", "other"] {
        let total = ledger_goes_on_from(executor);
        assert!((50..=101).contains(&total), "{executor}: {total}");
    }
}

#[test]
fn without_a_checkpoint_a_successor_begins_anew() {
    let mut daemon = Running::start(keeper("", "").path(), &["--inject", "keeper:crash.segv@0.2"]);
    assert_eq!(daemon.journal("fault", 1)[0].get("checkpoint"), None);
    daemon.wait_for_lines("keeper goes on from", 2);
    daemon.stop();
    assert_eq!(starts(&daemon), [(0, 0), (0, 0)]);
}

#[test]
fn a_region_that_is_not_there_is_a_fault_of_the_slot_that_registered_it() {
    let wild = "<property name=\"wild\" type=\"bool\">true</property>";
    let profiles = keeper(wild, "<reset limit=\"2\" within=\"60s\"/><checkpoint period=\"10ms\"/>");
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("ticker", "Ticker", "")));
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 3);
    assert!(faults.iter().all(|fault| fault["slot"] == "keeper" && fault["symptom"] == "crash.segv"));
    let actions: Vec<_> = faults.iter().map(|fault| fault["action"].as_str().unwrap()).collect();
    assert_eq!(actions, ["reset", "reset", "stop"]);
    let slots = daemon.stop();
    assert_eq!((slots[1]["state"].as_str(), slots[1]["faults"].as_u64()), (Some("active"), Some(0)));
}

#[test]
fn a_reload_while_a_spare_is_being_made_ends_what_was_made() {
    let profiles = heirs(&[("from", "100"), ("until", "100"), ("slow", "100")], "<spare count=\"1\"/>");
    let mut daemon = Running::start(profiles.path(), &[]);
    for (number, (before, after)) in [("1", "8"), ("8", "2")].into_iter().enumerate() {
        profiles.replace("app.xml", &format!("count=\"{before}\""), &format!("count=\"{after}\""));
        daemon.signal("HUP");
        assert_eq!(daemon.journal("reload", number + 1)[number]["changed"], serde_json::json!(["heir"]));
    }
    daemon.stop();
    // All that were ready ended: primaries, spares, and the one that was in the making.
    let (mut ready, mut ended) = (numbers(&daemon, "is ready"), numbers(&daemon, "ends"));
    ready.sort_unstable();
    ended.sort_unstable();
    assert_eq!(ready, ended);
}

#[test]
fn memory_is_locked_where_permitted_and_the_log_names_the_way_out_where_not() {
    let mut daemon = Running::start(heirs(&[], "").path(), &[]);
    let status = std::fs::read_to_string(format!("/proc/{}/status", daemon.id())).unwrap();
    let field = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_default().to_owned();
    let locked: u64 = field("VmLck:").trim_end_matches("kB").trim().parse().unwrap();
    let permitted = u64::from_str_radix(field("CapEff:").trim(), 16).unwrap() & (1 << 14) != 0;
    daemon.stop();
    let warned = daemon.lines("memory is not locked").len();
    assert!(if permitted { locked > 0 && warned == 0 } else { warned <= 1 }, "{locked} kB locked, {warned} warnings");
}

/// The check of a value follows a pointer that its writer forged: the writer's fault, and nothing stays locked or lent.
#[test]
fn a_forged_object_is_a_fault_of_its_writer_and_its_port_works_on() {
    let rules = "<fault_tolerance><severity>reset</severity><reset limit=\"1000\"/></fault_tolerance>";
    let slots = [slot("forger", "Forger", rules), slot("auditor", "Auditor", "")];
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    let wire = connection("forger.said -> auditor.heard", "<validity field=\"ranges\"><min>0</min></validity>");
    profiles.replace("app.xml", "</port_connections>", &format!("{wire}</port_connections>"));
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 20);
    assert!(faults.iter().all(|fault| fault["slot"] == "forger" && fault["symptom"] == "crash.segv"), "{faults:?}");
    assert!(faults.iter().all(|fault| fault["outcome"] == "recovered"));
    let seen = daemon.lines("audited").len();
    daemon.wait_for_lines("audited", seen + 3);
    let slots = daemon.stop();
    assert_eq!((slots[1]["state"].as_str(), slots[1]["faults"].as_u64()), (Some("active"), Some(0)));
    assert!(daemon.lines("audited").iter().all(|line| line.contains("[1.0, 2.0]")));
}
