//! Send: client, server, connection, handlers, active servers.

use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

use crate::rig::{RESET, Suite, Transport, conformance, declare_executors};

/// Sender, takers and boards.
pub(crate) fn profiles(transport: Transport, run: &str) -> Profiles {
    let cases = format!("<properties><property name=\"run\" type=\"string\">{run}</property></properties>");
    let on_the_right = |name: &str, class: &str| slot(name, class, &transport.place("right"));
    let slots = [
        slot("sender", "Sender", &format!("{cases}{}", transport.place("left"))),
        slot("taker", "Taker", &format!("{}{RESET}", transport.place("right"))),
        on_the_right("active", "ActiveTaker"),
        on_the_right("teller", "ActiveTeller"),
        on_the_right("board", "Board"),
        on_the_right("miser", "Miser"),
        on_the_right("other", "OtherBoard"),
    ];
    let links = [
        connection_of("service", "sender.order -> taker.orders", ""),
        connection_of("service", "sender.again -> taker.orders", "<on_gone>retry</on_gone>"),
        connection_of("service", "sender.taken -> taker.taken", ""),
        connection_of("service", "sender.active -> active.orders", ""),
        connection_of("service", "active.passed -> sender.told", ""),
        connection_of("service", "sender.asked -> teller.asked", ""),
        connection_of("service", "sender.board -> board.board", ""),
        connection_of("service", "sender.few -> board.board", ""),
    ];
    let profiles = Profiles::new(&application(&slots, &links.each_ref().map(String::as_str)));
    profiles.describe(&plugin_dir().join("libsends.so"));
    declare_executors(&profiles);
    let semantics = "<execution_semantics>";
    profiles.replace("Taker.xml", semantics, &format!("{semantics}<deadline hang=\"100ms\">50ms</deadline>"));
    profiles
}

pub(crate) static SUITE: Suite = Suite::new(|transport| profiles(transport, "sends"));

sends::send_cases!(conformance SUITE;);

#[test]
fn stop_while_an_active_server_waits() {
    for transport in [Transport::Near, Transport::Far] {
        let profiles = profiles(transport, "sends");
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for("case send_queued_by_an_active_server_is_fifo: ");
        let slots = daemon.stop();
        daemon.wait_for("the active taker was cancelled");
        let active: Vec<_> = slots.iter().filter(|slot| slot["slot"] == "active" || slot["slot"] == "teller").collect();
        assert!(active.len() == 2 && active.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
    }
}
