//! Components in a process, their end, and what takes the place of the originals' handshakes.

use std::process::Command;
use std::time::Duration;

use serde_json::{Value, json};
use tests::asking::ask;
use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

use crate::links;
use crate::rig::{Transport, declare_executors};

const BOTH: [Transport; 2] = [Transport::Near, Transport::Far];

/// Diaries on one executor or on two, and whatever else.
fn diaries(transport: Transport, more: &[String]) -> Profiles {
    let sides = ["left", "right", "left"].into_iter();
    let mut slots: Vec<String> = ["a", "b", "c"]
        .into_iter()
        .zip(sides)
        .map(|(name, side)| slot(name, "Diary", &transport.place(side)))
        .collect();
    slots.extend_from_slice(more);
    let profiles = Profiles::new(&application(&slots, &[]));
    declare_executors(&profiles);
    profiles
}

/// Who logged that hook, in order.
fn hooks(daemon: &Running, hook: &str) -> Vec<String> {
    let lines = daemon.lines(&format!(": hook {hook}"));
    lines.iter().filter_map(|line| line.split(": hook").next()?.rsplit(' ').next().map(str::to_owned)).collect()
}

fn components(daemon: &Running) -> Vec<Value> {
    ask(daemon, "component list --format json").json()
}

#[test]
fn slots_share_a_process() {
    for (transport, executors) in [(Transport::Near, 1), (Transport::Far, 2)] {
        let profiles = diaries(transport, &[]);
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for(&format!("ready: 3 slots on {executors} executors"));
        let all = components(&daemon);
        assert!(all.len() == 3 && all.iter().all(|slot| slot["state"] == "active"), "{all:?}");
        let children = format!("/proc/{0}/task/{0}/children", daemon.pid());
        assert_eq!(std::fs::read_to_string(children).unwrap_or_default(), "", "all run in the daemon's process");
        daemon.stop();
    }
}

#[test]
fn run_until_signal() {
    for (transport, signal) in BOTH.into_iter().flat_map(|transport| [(transport, "TERM"), (transport, "INT")]) {
        let profiles = diaries(transport, &[]);
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for_lines("hook update", 3);
        assert!(daemon.is_alive());
        daemon.signal(signal);
        assert!(daemon.wait().success());
        // Destructors run.
        assert_eq!((hooks(&daemon, "stop").len(), hooks(&daemon, "destroy").len()), (3, 3), "{}", daemon.log());
    }
}

#[test]
fn timers_by_period_and_task() {
    for transport in BOTH {
        let beside = transport.place("left");
        let profiles = diaries(transport, &[slot("ticker", "Ticker", &beside), slot("sleeper", "Sleeper", &beside)]);
        let mut daemon = Running::start(profiles.path(), &[]);
        let cycles = |name: &str| {
            let all = components(&daemon);
            all.iter().find(|slot| slot["slot"] == name).and_then(|slot| slot["cycles"].as_u64()).unwrap()
        };
        // A timer each, none of which waits for another one: not for the one that sleeps on their executor, either.
        while cycles("ticker") < 20 || cycles("sleeper") < 3 {
            std::thread::sleep(Duration::from_millis(5));
        }
        daemon.stop();
    }
}

#[test]
fn sigterm_gates_then_stops_in_reverse_order() {
    let profiles = diaries(Transport::Near, &[]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for_lines("hook update", 3);
    daemon.stop();
    assert_eq!(hooks(&daemon, "stop"), ["c", "b", "a"], "{}", daemon.log());
    // Who waits is told before it is stopped.
    for transport in BOTH {
        let profiles = crate::query::profiles(transport, "stay");
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for("waits");
        daemon.stop();
        let log = daemon.log();
        let (told, stopped) = (log.find("waited: Err("), log.find("asker: in stop"));
        assert!(told.is_some() && told < stopped, "{log}");
    }
}

#[test]
fn second_signal_leaves_at_once() {
    let stubborn: Vec<String> = (0..40).map(|number| slot(&format!("stubborn{number}"), "Stubborn", "")).collect();
    let profiles = diaries(Transport::Near, &stubborn);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.signal("TERM");
    daemon.wait_for("(Stubborn): hang");
    daemon.signal("TERM");
    assert!(!daemon.wait().success());
    assert!(daemon.lines("(Stubborn): hang").len() < 40, "it waited for all of them");
}

#[test]
fn hanging_component_does_not_hold_up_the_end() {
    for transport in BOTH {
        let stubborn = slot("stubborn", "Stubborn", &transport.place("right"));
        let profiles = diaries(transport, &[stubborn]);
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for_lines("hook update", 3);
        let slots = daemon.stop();
        daemon.wait_for("slot stubborn (Stubborn): hang");
        assert_eq!(hooks(&daemon, "destroy").len(), 3, "{}", daemon.log());
        assert!(slots.iter().all(|slot| slot["slot"] == "stubborn" || slot["faults"] == 0), "{slots:?}");
    }
}

fn connections(daemon: &Running, port: &str) -> Value {
    let info = ask(daemon, &format!("port info {port} --format json"));
    assert_eq!(info.code, Some(0), "{}", info.err);
    info.json()[0]["port"]["connections"].clone()
}

#[test]
fn server_end_tells_only_its_present_clients() {
    for transport in BOTH {
        let profiles = links::profiles(transport, "nothing");
        let mut daemon = Running::start(profiles.path(), &[]);
        for words in ["connect wirer.ask one.told", "connect wirer.again one.told", "connect wirer.ask two.told"] {
            assert_eq!(ask(&daemon, words).code, Some(0));
        }
        profiles.replace("app.xml", "<name>one</name>", "<name>three</name>");
        daemon.signal("HUP");
        daemon.wait_for("removed [one]");
        assert_eq!(connections(&daemon, "wirer.ask"), json!(["two.told"]));
        assert_eq!(connections(&daemon, "wirer.again"), json!([]));
        daemon.stop();
    }
}

#[test]
fn handshake_needs_none() {
    for transport in BOTH {
        let profiles = links::profiles(transport, "nothing");
        let mut daemon = Running::start(profiles.path(), &[]);
        assert_eq!(ask(&daemon, "connect wirer.ask other.same").code, Some(0));
        // Another server by the same name: what was connected to the old one does not reach it.
        profiles.replace("OtherAdder.xml", "<version>1.0</version>", "<version>1.1</version>");
        daemon.signal("HUP");
        daemon.wait_for("changed [other]");
        assert_eq!(connections(&daemon, "wirer.ask"), json!([]));
        assert_eq!(ask(&daemon, "connect wirer.ask other.same").code, Some(0));
        assert_eq!(connections(&daemon, "wirer.ask"), json!(["other.same"]));
        daemon.stop();
    }
}

#[test]
fn name_clash_is_refused_at_load() {
    let profiles = diaries(Transport::Near, &[slot("a", "Ticker", "")]);
    let mut command = Command::new(daemon_binary());
    let output = command.arg("check").arg(profiles.path()).arg("--plugins").arg(plugin_dir()).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(!output.status.success() && text.contains("slot \"a\" is already declared"), "{text}");
}
