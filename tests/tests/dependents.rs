//! What a fault-stop means for others: those that need the slot stop, and return when it does.

use serde_json::Value;
use tests::asking::{Answer, ask};
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

fn witnesses(names: &[&str], inside: &str) -> Profiles {
    let slots: Vec<String> = names.iter().map(|name| slot(name, "Witness", "")).collect();
    let profiles = Profiles::new(&application(&slots, &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles.replace("app.xml", "</application_profile>", &format!("{inside}</application_profile>"));
    profiles
}

fn dependency(component: &str, on: &str, require: &str) -> String {
    let require = if require.is_empty() { String::new() } else { format!(" require=\"{require}\"") };
    format!("<dependency component=\"{component}\" on=\"{on}\"{require}/>\n")
}

fn done(answer: Answer) -> Answer {
    assert_eq!(answer.code, Some(0), "{answer:?}");
    answer
}

/// State and reason of each slot.
fn states(daemon: &Running) -> Vec<(String, String, Option<String>)> {
    let status = done(ask(daemon, "status --format json")).json().remove(0);
    let text = |slot: &Value, name: &str| slot[name].as_str().map(str::to_owned);
    let slots = status["slots"].as_array().cloned().unwrap();
    slots.iter().map(|slot| (text(slot, "slot").unwrap(), text(slot, "state").unwrap(), text(slot, "reason"))).collect()
}

fn state_of(daemon: &Running, slot: &str) -> (String, Option<String>) {
    let found = states(daemon).into_iter().find(|(name, ..)| name == slot).unwrap();
    (found.1, found.2)
}

/// Slots in the order in which they said that word.
fn order(daemon: &Running, word: &str) -> Vec<String> {
    let lines = daemon.lines(word);
    let slot = |line: &String| {
        line.trim_end_matches(word).trim().rsplit([' ', ':']).find(|part| !part.is_empty()).map(str::to_owned)
    };
    lines.iter().filter_map(slot).collect()
}

/// To find the function that a trap struck in takes tens of milliseconds the first time: nobody drives on meanwhile.
#[test]
fn dependents_stop_before_the_fault_is_looked_into() {
    let profiles = witnesses(&["camera", "needy"], &dependency("needy", "camera", ""));
    let daemon = Running::start(profiles.path(), &["--inject", "camera:crash.segv@0.3"]);
    let (held, fault) = (daemon.journal("held", 1).remove(0), daemon.journal("fault", 1).remove(0));
    let number = |entry: &Value, field: &str| entry[field].as_u64().unwrap();
    // Both are written when the fault was looked into.
    let looked_ns = number(&held, "mono_ns") - number(&fault, "mono_ns");
    assert!(number(&held, "took_ns") < looked_ns / 2, "{held} {fault}");
    assert!(number(&fault, "seq") < number(&held, "seq"), "first the reason");
}

/// Figure 8 of the fault-tolerance paper: A goes on in spite of two faulty cameras of three, B, which needs all, stops; C
/// depends on B and stops for safety; D depends on A alone and goes on.
#[test]
fn figure_8_a_goes_on_b_stops_c_stops_for_safety_d_goes_on() {
    let rules = [
        dependency("a", "camera_1 camera_2 camera_3", "1"),
        dependency("b", "camera_1 camera_2 camera_3", "2"),
        dependency("c", "b", ""),
        dependency("d", "a", ""),
    ];
    let profiles = witnesses(&["camera_1", "camera_2", "camera_3", "a", "b", "c", "d"], &rules.concat());
    let faults = ["--inject", "camera_1:crash.segv@0.2", "--inject", "camera_2:crash.panic@0.6"];
    let daemon = Running::start(profiles.path(), &faults);
    let held = daemon.journal("held", 2);
    let faults = daemon.journal("fault", 2);
    assert!(faults.iter().all(|fault| fault["outcome"] == "stopped"), "{faults:?}");
    for (line, slot, reason) in [(&held[0], "b", "needs 2 of camera_1 camera_2 camera_3"), (&held[1], "c", "needs b")] {
        assert_eq!((line["slot"].as_str(), line["reason"].as_str()), (Some(slot), Some(reason)), "{line}");
        assert_eq!(line["root"], faults[1]["seq"], "the second camera was one too many");
        assert_eq!(state_of(&daemon, slot), ("inactive".to_owned(), Some(reason.to_owned())));
    }
    daemon.wait_for_lines("stops", 2);
    assert_eq!(order(&daemon, "stops"), ["c", "b"], "dependents first");
    for slot in ["camera_3", "a", "d"] {
        assert_eq!(state_of(&daemon, slot), ("active".to_owned(), None));
    }
    let text = done(ask(&daemon, "component info c")).out;
    assert!(text.contains("needs b"), "{text}");
    let listed = done(ask(&daemon, "fault list")).out;
    let sequence = faults[1]["seq"].as_u64().unwrap();
    assert!(listed.contains(&format!("needs b, fault {sequence}")), "{listed}");
    let shown = done(ask(&daemon, &format!("fault show {sequence}"))).out;
    for wanted in
        ["crash.panic", "injected panic", "what follows from it", "needs 2 of camera_1 camera_2 camera_3", "needs b"]
    {
        assert!(shown.contains(wanted), "{wanted} in\n{shown}");
    }
    let shown = done(ask(&daemon, &format!("fault show {sequence} --format json"))).json().remove(0);
    assert_eq!((&shown["fault"]["seq"], shown["follows"].as_array().map(Vec::len)), (&faults[1]["seq"], Some(2)));
    assert_eq!(ask(&daemon, "fault show 99999").code, Some(6));

    let answer = done(ask(&daemon, "component reset camera_2"));
    assert_eq!(answer.out, "camera_2: active\n");
    let returned = daemon.journal("returned", 2);
    assert_eq!((returned[0]["slot"].as_str(), returned[1]["slot"].as_str()), (Some("b"), Some("c")));
    assert!(states(&daemon).iter().filter(|(name, ..)| name != "camera_1").all(|(_, state, _)| state == "active"));
    daemon.wait_for_lines("starts", 9);
    assert!(order(&daemon, "starts").ends_with(&["b".to_owned(), "c".to_owned()]), "needed ones first");
    daemon.wait_for("camera_2: is reset");
    done(ask(&daemon, "component reset camera_1"));
    daemon.wait_for("camera_1: succeeds after reset by an operator");
    assert_eq!(state_of(&daemon, "camera_1"), ("active".to_owned(), None));
}

#[test]
fn an_operator_stops_and_starts_slots_and_those_that_need_them_follow() {
    let profiles = witnesses(
        &["camera", "planner", "motors"],
        &(dependency("planner", "camera", "") + &dependency("motors", "planner", "")),
    );
    let daemon = Running::start(profiles.path(), &[]);
    assert_eq!(done(ask(&daemon, "component stop camera")).out, "camera: inactive, told to stop\n");
    daemon.wait_for_lines("stops", 3);
    assert_eq!(order(&daemon, "stops"), ["motors", "planner", "camera"]);
    assert_eq!(state_of(&daemon, "motors"), ("inactive".to_owned(), Some("needs planner".to_owned())));
    assert!(daemon.journal("held", 2).iter().all(|line| line["root"].is_null()), "of no fault");
    let waits = done(ask(&daemon, "component start motors")).out;
    assert_eq!(waits, "motors: inactive, needs planner\n");
    done(ask(&daemon, "component stop planner"));
    done(ask(&daemon, "component start camera"));
    assert_eq!(state_of(&daemon, "motors").0, "inactive", "the planner was told to stop");
    done(ask(&daemon, "component start planner"));
    assert!(states(&daemon).iter().all(|(_, state, reason)| state == "active" && reason.is_none()));
    for (words, reason) in [
        ("component reset camera", "`camera` is active"),
        ("component start camra", "there is no slot `camra`"),
        ("fault clear", "nothing to clear"),
    ] {
        let wrong = ask(&daemon, words);
        assert_eq!(wrong.code, Some(6), "{wrong:?}");
        assert!(wrong.err.contains(reason), "{wrong:?}");
    }
}

#[test]
fn a_slot_that_recovers_never_stopped() {
    let profiles = witnesses(&["camera", "planner"], &dependency("planner", "camera", ""));
    profiles.replace(
        "app.xml",
        "<reference>Witness.xml</reference>",
        "<reference>Witness.xml</reference><fault_tolerance><severity>reset</severity></fault_tolerance>",
    );
    let mut daemon = Running::start(profiles.path(), &["--inject", "camera:crash.segv@0.2"]);
    assert_eq!(daemon.journal("fault", 1)[0]["outcome"], "recovered");
    daemon.stop();
    assert!(daemon.entries("held").is_empty());
}

#[test]
fn a_slot_that_lacks_what_it_needs_at_boot_is_not_started() {
    let profiles = witnesses(&["planner", "camera"], &dependency("planner", "camera", ""));
    profiles.replace(
        "Witness.xml",
        "</execution_semantics>",
        "<lifecycle_type>none</lifecycle_type></execution_semantics>",
    );
    profiles.replace(
        "app.xml",
        "<name>planner</name><reference>Witness.xml",
        "<name>planner</name><reference>Beat.xml",
    );
    let daemon = Running::start(profiles.path(), &[]);
    assert_eq!(state_of(&daemon, "planner"), ("ready".to_owned(), Some("needs camera".to_owned())));
    done(ask(&daemon, "component start camera"));
    assert_eq!(state_of(&daemon, "planner"), ("active".to_owned(), None));
}

#[test]
fn applications_depend_on_each_other_as_slots_do() {
    let profiles = witnesses(&["eye", "lid"], "");
    profiles.write(
        "drive.xml",
        "<application_profile><name>driving</name><subcomponents><subcomponent><name>wheels</name>\
         <reference>Witness.xml</reference></subcomponent><subcomponent><name>arm</name><reference>Witness.xml</reference>\
         </subcomponent></subcomponents></application_profile>",
    );
    profiles.write(
        "system.xml",
        "<system_profile><name>robot</name><dependency application=\"driving\" on=\"test\"/></system_profile>",
    );
    let daemon = Running::start(profiles.path(), &["--inject", "lid:crash.segv@0.2"]);
    let held = daemon.journal("held", 2);
    assert!(held.iter().all(|line| line["reason"] == "needs test"), "{held:?}");
    assert_eq!(state_of(&daemon, "eye").0, "active", "the application itself is not stopped for one of its slots");
    done(ask(&daemon, "component reset lid"));
    assert_eq!(daemon.journal("returned", 2).len(), 2);
    assert_eq!((state_of(&daemon, "wheels").0, state_of(&daemon, "arm").0), ("active".to_owned(), "active".to_owned()));
}

#[test]
fn a_fault_stop_may_cover_all_slots_of_its_executor() {
    let profiles = witnesses(&["one", "other", "third"], "");
    let rules = "<fault_tolerance><coverage>executor</coverage></fault_tolerance>";
    let on = |executor: &str, rules: &str| format!("<executor>{executor}</executor>{rules}</subcomponent>");
    for (slot, end) in [("one", on("left", rules)), ("other", on("left", "")), ("third", on("right", ""))] {
        let written = format!("<name>{slot}</name><reference>Witness.xml</reference></subcomponent>");
        let wanted = format!("<name>{slot}</name><reference>Witness.xml</reference>{end}");
        profiles.replace("app.xml", &written, &wanted);
    }
    profiles.executors(&["left", "right"]);
    let daemon = Running::start(profiles.path(), &["--inject", "one:crash.segv@0.2"]);
    let held = daemon.journal("held", 1).remove(0);
    assert_eq!((held["slot"].as_str(), held["reason"].as_str()), (Some("other"), Some("covered by the fault of one")));
    assert_eq!(state_of(&daemon, "third").0, "active");
    done(ask(&daemon, "component reset one"));
    assert_eq!(state_of(&daemon, "other"), ("active".to_owned(), None));
}

#[test]
fn a_reload_keeps_what_is_stopped_and_why() {
    let profiles = witnesses(&["camera", "planner", "other"], &dependency("planner", "camera", ""));
    let daemon = Running::start(profiles.path(), &["--inject", "camera:crash.segv@0.2"]);
    assert_eq!(daemon.journal("held", 1).len(), 1);
    done(ask(&daemon, "component stop other"));
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("new", "Witness", "")));
    profiles.replace(
        "app.xml",
        "</application_profile>",
        &format!("{}</application_profile>", dependency("new", "camera", "")),
    );
    done(ask(&daemon, "reload"));
    assert_eq!(state_of(&daemon, "planner"), ("inactive".to_owned(), Some("needs camera".to_owned())));
    assert_eq!(state_of(&daemon, "new"), ("ready".to_owned(), Some("needs camera".to_owned())));
    assert_eq!(state_of(&daemon, "other").0, "inactive");
    done(ask(&daemon, "component reset camera"));
    assert!(["planner", "new"].iter().all(|slot| state_of(&daemon, slot).0 == "active"));
    assert_eq!(state_of(&daemon, "other").0, "inactive", "an operator told it to stop");
}

#[test]
fn the_graph_shows_who_needs_whom() {
    let profiles = witnesses(&["a", "b", "c"], &dependency("c", "a b", "1"));
    for (kind, wanted) in [("dot", "\"c\" -> \"a\" [color"), ("mermaid", "s2 -.->|\"needs 1 of 2\"| s0")] {
        let drawn = tests::asking::graph(profiles.path(), kind);
        assert!(drawn.out.contains(wanted) && drawn.out.contains("needs 1 of 2"), "{drawn:?}");
    }
}
