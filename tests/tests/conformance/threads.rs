//! Threads: what a component runs beside its callbacks, and how it ends.

use std::process::Command;

use tests::asking::ask;
use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

use crate::rig::{RESET, Suite, Transport, conformance, declare_executors};

fn profiles(transport: Transport, run: &str) -> Profiles {
    let cases = format!("<properties><property name=\"run\" type=\"string\">{run}</property></properties>");
    let slots = [
        slot("tasker", "Tasker", &format!("{cases}{}", transport.place("left"))),
        slot("victim", "Victim", &format!("{}{RESET}", transport.place("right"))),
    ];
    let links = [
        connection_of("service", "tasker.ask -> victim.asked", ""),
        connection_of("service", "tasker.beside -> victim.asked", ""),
        connection_of("service", "tasker.own -> tasker.worked", ""),
        connection_of("service", "tasker.third -> victim.asked", ""),
        connection_of("service", "tasker.orders -> tasker.queued", ""),
        connection_of("data", "tasker.feed -> tasker.fed", ""),
        connection_of("data", "victim.timed -> tasker.clock", ""),
        connection_of("service", "victim.back -> tasker.worked", ""),
        connection_of("data", "tasker.sent -> tasker.heard", ""),
    ];
    let profiles = Profiles::new(&application(&slots, &links.each_ref().map(String::as_str)));
    profiles.describe(&plugin_dir().join("libtasks.so"));
    declare_executors(&profiles);
    // Those that the tasker may be on.
    for executor in ["main", "left"] {
        let name = format!("<executor name=\"{executor}\"");
        profiles.replace("system.xml", &name, &format!("{name} cpu=\"0\""));
    }
    let semantics = "<execution_semantics>";
    profiles.replace("Victim.xml", semantics, &format!("{semantics}<deadline hang=\"100ms\">50ms</deadline>"));
    profiles
}

static SUITE: Suite = Suite::new(|transport| profiles(transport, "all"));

tasks::task_cases!(conformance SUITE;);

#[test]
fn sigterm_cancels_tasks_and_joins_them() {
    for transport in [Transport::Near, Transport::Far] {
        let profiles = profiles(transport, "stay");
        let mut daemon = Running::start(profiles.path(), &[]);
        ["task ran thrice", "task sleeps", "task works"].iter().for_each(|text| daemon.wait_for(text));
        let slots = daemon.stop();
        let log = daemon.log();
        for text in ["task slept: false, cancelled: true", "task worked", "task left, cancelled: true"] {
            assert!(log.contains(text), "`{text}` in {log}");
        }
        assert!(slots.iter().all(|slot| slot["faults"] == 0 && slot["quarantined"] == 0), "{slots:?}");
    }
}

#[test]
fn hanging_task_does_not_hold_up_the_end() {
    for transport in [Transport::Near, Transport::Far] {
        let profiles = profiles(transport, "hang");
        let mut daemon = Running::start(profiles.path(), &[]);
        std::thread::sleep(std::time::Duration::from_millis(50));
        let slots = daemon.stop();
        let tasker = slots.iter().find(|slot| slot["slot"] == "tasker").expect("it is listed");
        assert_eq!((&tasker["faults"], &tasker["quarantined"]), (&1.into(), &1.into()), "{slots:?}");
        let fault = &daemon.entries("fault")[0];
        assert_eq!((&fault["symptom"], &fault["slot"]), (&"hang".into(), &"tasker".into()), "{fault}");
    }
}

/// What an operator sees of the tasker.
fn info(daemon: &Running) -> String {
    let mut command = Command::new(daemon_binary());
    let output = command.args(["component", "info", "tasker", "--socket"]).arg(daemon.socket()).output();
    String::from_utf8_lossy(&output.expect("the daemon's binary runs").stdout).into_owned()
}

/// A slot with a task that asks by a port of its own, after the task was answered.
fn lending(transport: Transport, arguments: &[&str]) -> (Profiles, Running) {
    let profiles = profiles(transport, "lend");
    let daemon = Running::start(profiles.path(), arguments);
    daemon.wait_for("task was answered");
    (profiles, daemon)
}

fn order(daemon: &Running, verb: &str) {
    let answer = ask(daemon, &format!("component {verb} tasker"));
    assert_eq!(answer.code, Some(0), "{}", answer.err);
}

#[test]
fn a_slot_that_starts_again_has_its_tasks_and_they_their_ports() {
    for transport in [Transport::Near, Transport::Far] {
        let (_profiles, mut daemon) = lending(transport, &[]);
        order(&daemon, "stop");
        order(&daemon, "start");
        daemon.wait_for_lines("task was answered", 2);
        let slots = daemon.stop();
        assert!(slots.iter().all(|slot| slot["faults"] == 0 && slot["quarantined"] == 0), "{slots:?}");
    }
}

#[test]
fn a_slot_whose_task_was_ended_by_force_starts_again_with_another_instance() {
    for transport in [Transport::Near, Transport::Far] {
        let profiles = profiles(transport, "hang");
        let mut daemon = Running::start(profiles.path(), &[]);
        let works = || daemon.until("its task", || info(&daemon).contains("hangs"));
        works();
        order(&daemon, "stop");
        let faults = daemon.journal("fault", 1);
        assert_eq!((&faults[0]["slot"], &faults[0]["symptom"]), (&"tasker".into(), &"hang".into()), "{faults:?}");
        order(&daemon, "start");
        works();
        let slots = daemon.stop();
        let tasker = slots.iter().find(|slot| slot["slot"] == "tasker").expect("it is listed");
        assert_eq!(tasker["quarantined"], 2, "{slots:?}");
    }
}

#[test]
fn a_slot_that_is_reset_after_a_fault_stopped_it_has_its_tasks_again() {
    for transport in [Transport::Near, Transport::Far] {
        let (_profiles, mut daemon) = lending(transport, &["--inject", "tasker:error@0.5"]);
        let faults = daemon.journal("fault", 1);
        assert_eq!((&faults[0]["slot"], &faults[0]["action"]), (&"tasker".into(), &"stop".into()), "{faults:?}");
        order(&daemon, "reset");
        daemon.wait_for_lines("task was answered", 2);
        daemon.stop();
        assert_eq!(daemon.entries("fault").len(), 1, "{:?}", daemon.entries("fault"));
    }
}

#[test]
fn a_reload_ends_the_tasks_of_what_is_built_anew_and_its_successor_starts_its_own() {
    for transport in [Transport::Near, Transport::Far] {
        let profiles = profiles(transport, "stay");
        let mut daemon = Running::start(profiles.path(), &[]);
        daemon.wait_for("task works");
        profiles.replace("Tasker.xml", "<version>1.0</version>", "<version>1.1</version>");
        daemon.signal("HUP");
        daemon.wait_for_lines("task left, cancelled: true", 1);
        daemon.wait_for_lines("task works", 2);
        let shown = info(&daemon);
        for text in ["ticks", "every 5ms", "sleeps", "once"] {
            assert!(shown.contains(text), "`{text}` in {shown}");
        }
        let slots = daemon.stop();
        assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
    }
}
