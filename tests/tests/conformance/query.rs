//! Query: client, server, disconnection, blocking, handlers.

use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

use crate::rig::{
    RESET, Suite, Transport, conformance, declare_executors, is_built_anew_while_parked, is_stopped_while_parked,
    parked,
};

/// Asker, teller and a third one.
pub(crate) fn profiles(transport: Transport, run: &str) -> Profiles {
    let cases = format!("<properties><property name=\"run\" type=\"string\">{run}</property></properties>");
    let slots = [
        slot("asker", "Asker", &format!("{cases}{}", transport.place("left"))),
        slot("teller", "Teller", &format!("{}{RESET}", transport.place("right"))),
        slot("echo", "Echo", &transport.place("right")),
    ];
    let links = [
        connection_of("service", "asker.tell -> teller.told", ""),
        connection_of("service", "asker.again -> teller.told", "<on_gone>retry</on_gone>"),
        connection_of("service", "asker.own -> asker.answers", ""),
        connection_of("service", "teller.onward -> echo.told", ""),
        connection_of("service", "teller.back -> asker.answers", ""),
        connection_of("service", "echo.back -> asker.answers", ""),
    ];
    let profiles = Profiles::new(&application(&slots, &links.each_ref().map(String::as_str)));
    profiles.describe(&plugin_dir().join("libqueries.so"));
    declare_executors(&profiles);
    // The second required port times out soon.
    profiles.replace_after("Asker.xml", "<name>again</name>", "<timeout>1s</timeout>", "<timeout>100ms</timeout>");
    let semantics = "<execution_semantics>";
    profiles.replace("Teller.xml", semantics, &format!("{semantics}<deadline hang=\"100ms\">50ms</deadline>"));
    profiles
}

pub(crate) static SUITE: Suite = Suite::new(|transport| profiles(transport, "all"));

queries::query_cases!(conformance SUITE;);

#[test]
fn wired_at_boot_waits_for_its_server() {
    for transport in [Transport::Near, Transport::Far] {
        let slots = [slot("early", "Early", &transport.place("left")), slot("late", "Late", &transport.place("right"))];
        let link = connection_of("service", "early.tell -> late.told", "");
        let profiles = Profiles::new(&application(&slots, &[&link]));
        profiles.describe(&plugin_dir().join("libqueries.so"));
        declare_executors(&profiles);
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for("was told Ok(2)");
        daemon.stop();
        let log = daemon.log();
        let (asked, started) = (log.find("asks early"), log.find("starts late"));
        // On one executor it asks when the other has started.
        assert!(matches!(transport, Transport::Near) || asked < started, "{log}");
    }
}

#[test]
fn stop_while_parked() {
    for transport in [Transport::Near, Transport::Far] {
        let (_profiles, mut daemon) = parked(profiles(transport, "stay"));
        is_stopped_while_parked(&mut daemon);
    }
}

#[test]
fn wait_in_constructor_stop_destroy_recover_is_cancelled() {
    let (_profiles, mut daemon) = parked(profiles(Transport::Far, "stay"));
    daemon.stop();
    daemon.wait_for("in initialize: Some(Disconnected)");
    let stop = daemon.lines("in stop: ");
    assert!(!stop.is_empty() && stop.iter().all(|line| !line.contains("None")), "{stop:?}");
}

#[test]
fn server_ends_in_order() {
    for transport in [Transport::Near, Transport::Far] {
        let (profiles, mut daemon) = parked(profiles(transport, "stay"));
        // The teller is built anew.
        profiles.replace("Teller.xml", "<version>1.0</version>", "<version>1.1</version>");
        daemon.signal("HUP");
        daemon.wait_for("waited: Err(ProviderReplaced)");
        daemon.wait_for_lines(": waits", 2);
        // Until the new one is there it is told the same again; then it waits.
        let mut before = usize::MAX;
        while daemon.lines("waited: ").len() != before {
            before = daemon.lines("waited: ").len();
            std::thread::sleep(std::time::Duration::from_millis(300));
        }
        let ends = daemon.lines("waited: ");
        assert!(ends.iter().all(|end| end.contains("ProviderReplaced")), "{ends:?}");
        assert!(daemon.lines(": waits").len() > ends.len());
        daemon.stop();
    }
}

#[test]
fn reload_while_parked() {
    for transport in [Transport::Near, Transport::Far] {
        is_built_anew_while_parked(profiles(transport, "stay"), "Asker");
    }
}

#[test]
fn remove_while_parked() {
    for transport in [Transport::Near, Transport::Far] {
        let (profiles, mut daemon) = parked(profiles(transport, "stay"));
        // Its successor has another name: the plan has it no longer.
        let text = std::fs::read_to_string(profiles.path().join("app.xml")).expect("written");
        profiles.write("app.xml", &text.replace("asker", "inquirer"));
        daemon.signal("HUP");
        daemon.wait_for("waited: Err(Cancelled)");
        daemon.wait_for("removed [asker]");
        daemon.wait_for("inquirer: waits");
        let slots = daemon.stop();
        assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
    }
}
