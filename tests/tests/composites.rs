//! Composites in a system that runs: nothing but names, and these are good for whatever a slot's are good for.

use serde_json::Value;
use tests::asking::ask;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

/// A composite of these subcomponents, and what it shows: `inner.port -> name`.
fn composite(name: &str, slots: &[String], inside: &[&str], shown: &[&str]) -> String {
    let text = application(slots, inside).replace("application_profile", "composite_component_profile");
    let export = |shown: &&str| {
        let (inner, name) = shown.split_once(" -> ").unwrap();
        let (slot, port) = inner.split_once('.').unwrap();
        format!(
            "<export_port><component_name>{slot}</component_name><port_name>{port}</port_name>\
             <port_type>data</port_type><export_port_name>{name}</export_port_name></export_port>"
        )
    };
    let exports: String = shown.iter().map(export).collect();
    text.replace("<name>test</name>", &format!("<name>{name}</name>"))
        .replace("</composite", &format!("<export_ports>{exports}</export_ports></composite"))
}

const RULES: &str = "<executor>main</executor><fault_tolerance><severity>reset</severity></fault_tolerance>";

/// A sender that runs no cases.
const IDLE: &str = "<properties><property name=\"run\">nothing</property></properties>";

fn property(name: &str, value: &str) -> String {
    format!("<properties><property name=\"{name}\">{value}</property></properties>")
}

/// A head that ticks and relays, two ears, and a listener that hears the head.
fn profiles(more: &[String]) -> Profiles {
    let inside = format!("{}{RULES}", property("ticker.first", "1000"));
    let mut slots = vec![slot("head", "Head", &inside), slot("ears", "Ears", ""), slot("listener", "Listener", "")];
    slots.extend_from_slice(more);
    let profiles = Profiles::new(&application(&slots, &["head.said -> listener.heard"]));
    let head = [slot("ticker", "Ticker", ""), slot("relay", "Relay", "<executor>other</executor>")];
    let shown = ["relay.said -> said"];
    profiles.write("Head.xml", &composite("Head", &head, &["ticker.out -> relay.heard"], &shown));
    let ears = ["left", "right"].map(|name| slot(name, "Listener", ""));
    let shown = ["left.heard -> heard", "right.heard -> heard"];
    profiles.write("Ears.xml", &composite("Ears", &ears, &[], &shown));
    profiles.executors(&["main", "other"]);
    profiles
}

fn told(daemon: &Running, words: &str) -> Vec<Value> {
    let answer = ask(daemon, &format!("{words} --format json"));
    assert_eq!(answer.code, Some(0), "{words}: {}", answer.err);
    answer.json()
}

fn connections(daemon: &Running, port: &str) -> Value {
    told(daemon, &format!("port info {port}"))[0]["port"]["connections"].clone()
}

#[test]
fn composite_port_is_a_name() {
    let profiles = profiles(&[]);
    let mut daemon = Running::start(profiles.path(), &[]);
    assert_eq!(connections(&daemon, "head.said"), serde_json::json!(["listener.heard"]));
    // One name, two readers.
    assert_eq!(ask(&daemon, "connect head.said ears.heard").code, Some(0));
    for ear in ["ears.left.heard", "ears.right.heard"] {
        assert_eq!(connections(&daemon, ear), serde_json::json!(["head.relay.said"]));
    }
    daemon.wait_for("ears.left: heard 101");
    daemon.wait_for("ears.right: heard 101");
    assert_eq!(ask(&daemon, "disconnect ears.heard").code, Some(0));
    for ear in ["ears.left.heard", "ears.right.heard"] {
        assert_eq!(connections(&daemon, ear), serde_json::json!([]));
    }
    assert_eq!(connections(&daemon, "listener.heard"), serde_json::json!(["head.relay.said"]));
    for (words, reason) in [
        ("connect head.sight listener.heard", "slot head has no port sight"),
        ("connect tail.said listener.heard", "there is no slot tail"),
        ("connect ears.heard listener.heard", "each is an input"),
    ] {
        let refused = ask(&daemon, words);
        assert!(refused.code == Some(6) && refused.err.contains(reason), "{words}: {}", refused.err);
    }
    daemon.stop();
}

#[test]
fn a_component_wires_a_composite() {
    let choice = "<properties><property name=\"reader\">ears.heard</property>\
                  <property name=\"writers\">head.said other.out</property></properties>";
    let profiles = profiles(&[slot("other", "Ticker", ""), slot("switch", "Switch", choice)]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("ears.left: heard 101");
    daemon.wait_for("ears.right: heard 101");
    daemon.wait_for("connected ears.heard and head.said");
    daemon.wait_for("connected ears.heard and other.out");
    let slots = daemon.stop();
    assert!(daemon.lines("WARN switch").is_empty() && slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
}

#[test]
fn a_composite_is_shown_with_its_slots_and_hands_down_what_is_said_of_it() {
    let profiles = profiles(&[]);
    let mut daemon = Running::start(profiles.path(), &[]);
    let components = told(&daemon, "component list");
    let head = components.iter().find(|component| component["slot"] == "head").expect("the composite is listed");
    assert_eq!(head["slots"], serde_json::json!(["head.ticker", "head.relay"]));
    assert_eq!(
        (&head["class"], &head["state"], &head["executor"]),
        (&"Head".into(), &"active".into(), &"several".into())
    );
    assert!(ask(&daemon, "component list").out.contains("head.ticker, head.relay"));
    let info = ask(&daemon, "component info head").out;
    assert!(info.contains("said") && info.contains("head.relay.said"), "{info}");
    // Its rules are defaults: who says something of his own keeps to it.
    let slot = |name: &str| told(&daemon, &format!("component info {name}"))[0]["component"].clone();
    let (ticker, relay) = (slot("head.ticker"), slot("head.relay"));
    assert_eq!((&ticker["executor"], &relay["executor"]), (&"main".into(), &"other".into()));
    assert_eq!(ticker["severity"]["crash.segv"], "reset", "{ticker}");
    assert_eq!(relay["severity"]["crash.segv"], "reset", "{relay}");
    daemon.wait_for("head.ticker: starts at 1000");
    let ports = told(&daemon, "port list ears");
    assert!(ports.len() == 2 && ports.iter().all(|port| port["port"] == "heard"), "{ports:?}");
    assert_eq!(told(&daemon, "port info head.said")[0]["port"]["is"], "head.relay.said");
    let all = told(&daemon, "port list");
    assert!(all.iter().any(|port| port["slot"] == "head" && port["port"] == "said"), "{all:?}");
    let rate = told(&daemon, "port hz head.said --window 0.1 --count 1");
    assert_eq!(rate[0]["rate"]["measured_at"], "listener.heard");
    assert_eq!(told(&daemon, "port echo head.said --count 1").len(), 1);
    let wrong = ask(&daemon, "component info haed");
    assert!(wrong.code == Some(6) && wrong.err.contains("`head`"), "{}", wrong.err);
    daemon.stop();
}

#[test]
fn a_reload_renames_what_a_composite_shows_and_touches_no_slot() {
    let profiles = profiles(&[]);
    let mut daemon = Running::start(profiles.path(), &[]);
    profiles.replace(
        "Head.xml",
        "<export_port_name>said</export_port_name>",
        "<export_port_name>told</export_port_name>",
    );
    profiles.replace("app.xml", "port_name=\"said\"", "port_name=\"told\"");
    daemon.signal("HUP");
    daemon.wait_for("reloaded: added [], changed [], removed [], 5 not touched");
    assert_eq!(ask(&daemon, "connect head.told ears.heard").code, Some(0));
    assert_eq!(ask(&daemon, "connect head.said ears.heard").code, Some(6));
    assert_eq!(
        connections(&daemon, "head.told"),
        serde_json::json!(["listener.heard", "ears.left.heard", "ears.right.heard"])
    );
    // What is said of the composite counts for its slots.
    profiles.replace("app.xml", "1000", "2000");
    daemon.signal("HUP");
    daemon.wait_for("changed [head.ticker]");
    daemon.wait_for("head.ticker: starts at 2000");
    daemon.stop();
}

#[test]
fn a_service_with_methods_is_shown_by_one_name() {
    let profiles = Profiles::new(&application(&[slot("box", "Box", ""), slot("caller", "Sender", IDLE)], &[]));
    profiles.describe(&plugin_dir().join("libsends.so"));
    let inside = composite("Box", &[slot("board", "Board", "")], &[], &["board.board -> motors"]);
    profiles.write("Box.xml", &inside.replace("<port_type>data</port_type>", "<port_type>service</port_type>"));
    let mut daemon = Running::start(profiles.path(), &[]);
    let shown = told(&daemon, "port list box");
    assert!(
        shown.iter().all(|port| port["port"].as_str().is_some_and(|name| name.starts_with("motors/"))),
        "{shown:?}"
    );
    assert!(!shown.is_empty());
    assert_eq!(ask(&daemon, "connect caller.nobody box.motors").code, Some(0));
    let called = || -> Vec<Value> {
        let own = |port: &Value| port["port"].as_str().is_some_and(|name| name.starts_with("nobody/"));
        told(&daemon, "port list caller").into_iter().filter(own).map(|port| port["connections"].clone()).collect()
    };
    assert!(called().iter().all(|ends| ends[0].as_str().is_some_and(|end| end.starts_with("box.board.board/"))));
    assert_eq!(ask(&daemon, "connect caller.nobody box.engines").code, Some(6));
    assert!(called().iter().all(|ends| *ends == serde_json::json!([])));
    daemon.stop();
}
