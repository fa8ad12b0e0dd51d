//! Event: clients, servers, and event ports of OPRoS.

use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

use crate::check::check;
use crate::rig::{
    RESET, Suite, Transport, conformance, declare_executors, is_built_anew_while_parked, is_stopped_while_parked,
    parked,
};

/// Watcher, measurer and another one.
pub(crate) fn profiles(transport: Transport, run: &str, rules: &str) -> Profiles {
    let cases = format!("<properties><property name=\"run\" type=\"string\">{run}</property></properties>");
    let slots = [
        slot("measurer", "Measurer", &format!("{}{rules}", transport.place("right"))),
        slot("other", "OtherMeasurer", &transport.place("right")),
        slot("watcher", "Watcher", &format!("{cases}{}{RESET}", transport.place("left"))),
    ];
    let links = [
        connection_of("service", "watcher.ask -> measurer.told", ""),
        connection_of("event", "measurer.levels -> watcher.level", ""),
        connection_of("event", "measurer.levels -> watcher.heard", ""),
        connection_of("event", "watcher.mine -> watcher.own", ""),
        connection_of("event", "measurer.tells -> watcher.alarms", ""),
        connection_of("event", "measurer.tells -> watcher.notes", ""),
        connection_of("event", "measurer.tells -> watcher.first_notes", ""),
    ];
    let text =
        application(&slots, &[]).replace("</port_connections>", &format!("{}</port_connections>", links.concat()));
    let profiles = Profiles::new(&text);
    profiles.describe(&plugin_dir().join("libevents.so"));
    declare_executors(&profiles);
    settle(&profiles, "level", "<timeout>1s</timeout>", "<timeout>100ms</timeout>");
    settle(&profiles, "heard", "<queue_size>15</queue_size>", "<queue_size>2</queue_size>");
    let size = "<queue_size>3</queue_size>";
    settle(&profiles, "first_notes", size, &format!("{size}<overflow>drop_newest</overflow>"));
    profiles
}

/// Sets what the watcher's profile says about a port.
fn settle(profiles: &Profiles, port: &str, described: &str, wanted: &str) {
    let watcher = std::fs::read_to_string(profiles.path().join("Watcher.xml")).expect("described");
    let (before, after) = watcher.split_once(&format!("<name>{port}</name>")).expect("the port is described");
    assert!(after.contains(described), "{after}");
    profiles.write("Watcher.xml", &format!("{before}<name>{port}</name>{}", after.replacen(described, wanted, 1)));
}

static SUITE: Suite = Suite::new(|transport| profiles(transport, "all", RESET));

events::event_cases!(conformance SUITE;);

#[test]
fn stop_while_parked_for_an_event() {
    for transport in [Transport::Near, Transport::Far] {
        let (_profiles, mut daemon) = parked(profiles(transport, "stay", RESET));
        is_stopped_while_parked(&mut daemon);
        daemon.wait_for("in initialize: Some(Disconnected)");
        let stop = daemon.lines("in stop: ");
        assert!(!stop.is_empty() && stop.iter().all(|line| !line.contains("None")), "{stop:?}");
    }
}

#[test]
fn server_ends_in_order() {
    for transport in [Transport::Near, Transport::Far] {
        let (profiles, mut daemon) = parked(profiles(transport, "stay", RESET));
        profiles.replace("Measurer.xml", "<version>1.0</version>", "<version>1.1</version>");
        daemon.signal("HUP");
        daemon.wait_for("waited: Err(ProviderReplaced)");
        daemon.wait_for("the id was gone");
        daemon.wait_for_lines(": waits", 2);
        daemon.stop();
    }
}

#[test]
fn reload_while_parked_for_an_event() {
    for transport in [Transport::Near, Transport::Far] {
        is_built_anew_while_parked(profiles(transport, "stay", RESET), "Watcher");
    }
}

#[test]
fn activations_of_a_replaced_client_are_over() {
    for transport in [Transport::Near, Transport::Far] {
        let profiles = profiles(transport, "fall", RESET);
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for("tested before: 5");
        daemon.wait_for("tested afterwards: ");
        daemon.stop();
    }
}

#[test]
fn declared_event_ends_are_wireable_ports() {
    let (is_good, text) = check(&profiles(Transport::Near, "all", RESET));
    assert!(is_good && !text.contains("not active"), "{text}");
}

#[test]
fn event_ends_that_do_not_match_are_refused_at_load() {
    let wrong = |from: &str, to: &str, parts: &[&str]| {
        let profiles = profiles(Transport::Near, "all", RESET);
        let link = connection_of("event", &format!("{from} -> {to}"), "");
        profiles.replace("app.xml", "</port_connections>", &format!("{link}</port_connections>"));
        let (is_good, text) = check(&profiles);
        assert!(!is_good, "{text}");
        parts.iter().for_each(|part| assert!(text.contains(part), "`{part}` in {text}"));
    };
    wrong("other.levels", "watcher.loose", &["other.levels tells of", "watcher.loose asks for", "layouts differ"]);
    wrong(
        "measurer.tells",
        "watcher.loose",
        &["measurer.tells is an event output", "an EventOut goes with an EventIn"],
    );
    wrong("measurer.levels", "watcher.alarms", &["watcher.alarms is an event input"]);
    wrong("watcher.mine", "watcher.level", &["watcher.level is already connected to a server"]);
}

#[test]
fn a_setting_of_the_other_side_of_events_is_refused() {
    let profiles = profiles(Transport::Near, "all", RESET);
    let measurer = std::fs::read_to_string(profiles.path().join("Measurer.xml")).unwrap();
    let (before, after) = measurer.split_once("<name>levels</name>").unwrap();
    profiles.write("Measurer.xml", &format!("{before}<name>levels</name><activations>4</activations>{after}"));
    let (is_good, text) = check(&profiles);
    assert!(!is_good && text.contains("<activations> belongs to an input of events"), "{text}");
}
