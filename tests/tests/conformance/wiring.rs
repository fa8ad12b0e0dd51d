//! The wiring pattern.

use tests::asking::ask;
use tests::running::Running;

use crate::links::profiles;
use crate::rig::{Suite, Transport, conformance};

pub(crate) static SUITE: Suite = Suite::new(|transport| profiles(transport, "wiring"));

links::wiring_cases!(conformance SUITE;);

#[test]
fn ports_are_named_from_start_on_and_a_successor_finds_its_name() {
    let profiles = profiles(Transport::Far, "nothing");
    let mut daemon = Running::start(profiles.path(), &["--inject", "lister:crash.segv@0.2"]);
    daemon.wait_for_lines("lister: shown as shown", 2);
    daemon.wait_for("in initialize: Err(Disconnected)");
    assert_eq!(ask(&daemon, "connect lister.shown one.told").code, Some(0));
    daemon.stop();
}

#[test]
fn unknown_command_word() {
    let profiles = profiles(Transport::Far, "nothing");
    let mut daemon = Running::start(profiles.path(), &[]);
    let mut wire = tests::asking::Wire::to(&daemon);
    let reply = wire.ask("Reconnect", &serde_json::json!({}));
    assert_eq!(reply["error"], "org.varlink.service.MethodNotFound", "{reply}");
    daemon.stop();
}

#[test]
fn cli_and_reload_use_the_same() {
    let profiles = profiles(Transport::Far, "nothing");
    let mut daemon = Running::start(profiles.path(), &[]);
    let code = |words: &str| {
        let answer = ask(&daemon, words);
        (answer.code, answer.err)
    };
    assert_eq!(code("connect wirer.ask one.told").0, Some(0));
    let (status, text) = code("connect wirer.ask other.other");
    assert!(status == Some(6) && text.contains("wirer.ask") && text.contains("other.other"), "{text}");
    // A refusal leaves the client disconnected.
    let info = ask(&daemon, "port info wirer.ask --format json");
    assert!(!info.out.contains("other") && !info.out.contains("\"one"), "{}", info.out);
    let (status, text) = code("connect wirer.hidden one.told");
    assert!(status == Some(6) && text.contains("wirer.hidden"), "{text}");
    assert_eq!(code("connect wirer.ask two.told").0, Some(0));
    // No plan speaks of it: a reload leaves it.
    profiles.replace("app.xml", "<name>lister</name>", "<name>shower</name>");
    daemon.signal("HUP");
    daemon.wait_for("reloaded: ");
    let info = ask(&daemon, "port info wirer.ask --format json");
    assert!(info.out.contains("two"), "{}", info.out);
    // A plan that does speak of it.
    let link = tests::profiles::connection_of("service", "wirer.ask -> one.told", "");
    profiles.replace("app.xml", "</port_connections>", &format!("{link}</port_connections>"));
    daemon.signal("HUP");
    daemon.wait_for_lines("reloaded: ", 2);
    let info = ask(&daemon, "port info wirer.ask --format json");
    assert!(info.out.contains("one") && !info.out.contains("two"), "{}", info.out);
    profiles.replace("app.xml", &link, "");
    daemon.signal("HUP");
    daemon.wait_for_lines("reloaded: ", 3);
    let info = ask(&daemon, "port info wirer.ask --format json");
    assert!(!info.out.contains("\"one"), "{}", info.out);
    daemon.stop();
}
