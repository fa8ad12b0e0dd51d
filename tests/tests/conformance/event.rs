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
    let profiles = Profiles::new(&application(&slots, &links.each_ref().map(String::as_str)));
    profiles.describe(&plugin_dir().join("libevents.so"));
    declare_executors(&profiles);
    let settle = |port: &str, described: &str, wanted: &str| {
        profiles.replace_after("Watcher.xml", &format!("<name>{port}</name>"), described, wanted);
    };
    settle("level", "<timeout>1s</timeout>", "<timeout>100ms</timeout>");
    settle("heard", "<queue_size>15</queue_size>", "<queue_size>2</queue_size>");
    let size = "<queue_size>3</queue_size>";
    settle("first_notes", size, &format!("{size}<overflow>drop_newest</overflow>"));
    profiles
}

pub(crate) static SUITE: Suite = Suite::new(|transport| profiles(transport, "all", RESET));

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
    let name = "<name>levels</name>";
    profiles.replace("Measurer.xml", name, &format!("{name}<activations>4</activations>"));
    let (is_good, text) = check(&profiles);
    assert!(!is_good && text.contains("<activations> belongs to an input of events"), "{text}");
}
