//! `port echo`: what passes a port is shown, whatever it is and whatever becomes of the port, and nobody notices.

use std::time::Duration;

use serde_json::json;
use tests::asking::{Answer, ask, finish, start};
use tests::profiles::{Profiles, application, connection_of, plugin_dir, slot};
use tests::running::Running;

fn pair() -> Profiles {
    Profiles::new(&application(
        &[slot("ticker", "Ticker", ""), slot("listener", "Listener", "")],
        &["ticker.out -> listener.heard"],
    ))
}

fn done(answer: Answer) -> Answer {
    assert_eq!(answer.code, Some(0), "{answer:?}");
    answer
}

#[test]
fn values_of_an_output_are_shown_in_order() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let shown = done(ask(&daemon, "port echo ticker.out --count 20 --format json")).json();
    let echoes: Vec<_> = shown.iter().map(|answer| &answer["echo"]).collect();
    assert_eq!(echoes.len(), 20);
    for pair in echoes.windows(2) {
        let number = |echo: &serde_json::Value| echo["value"]["number"].as_u64().unwrap();
        // What was passed over is told.
        let missed = pair[1]["missed"].as_u64().unwrap();
        assert!(number(pair[1]) > number(pair[0]), "{pair:?}");
        assert!(number(pair[1]) - number(pair[0]) <= missed + 1, "{pair:?}");
        assert!(pair[1]["stamp_ns"].as_u64() > pair[0]["stamp_ns"].as_u64(), "{pair:?}");
    }
    assert_eq!((&echoes[0]["value"]["sender"], &echoes[0]["from"]), (&json!("ticker"), &json!("ticker.out")));
    // It leaves nothing behind.
    let info = done(ask(&daemon, "port info ticker.out --format json")).json().remove(0);
    assert_eq!(info["port"]["connections"], json!(["listener.heard"]));
}

#[test]
fn values_of_an_input_are_those_of_its_writers_and_people_can_read_them() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let text = done(ask(&daemon, "port echo listener.heard --count 1")).out;
    assert!(text.starts_with("ticker.out at ") && text.contains("\n  number: ") && text.contains("\n  sender: ticker"));
}

#[test]
fn what_has_no_values_is_refused() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let refused = ask(&daemon, "port echo ticker.oot --count 1");
    assert!(refused.code == Some(6) && refused.err.contains("ticker.out"), "{refused:?}");
}

#[test]
fn a_value_that_leads_nowhere_is_unreadable_and_harms_nobody() {
    let profiles = Profiles::new(&application(&[slot("wild", "Wild", "")], &[]));
    profiles.describe(&plugin_dir().join("libpushes.so"));
    let mut daemon = Running::start(profiles.path(), &[]);
    let shown = done(ask(&daemon, "port echo wild.out --count 5 --format json")).json();
    assert!(shown.iter().all(|answer| answer["echo"]["value"].is_null()), "{shown:?}");
    assert!(shown.iter().all(|answer| answer["echo"]["unreadable"].as_str().unwrap().contains("0x8")), "{shown:?}");
    let slots = daemon.stop();
    assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
}

#[test]
fn it_goes_with_its_port_through_disconnections_and_reloads() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let following = start(&daemon, "port echo ticker.out --count 400 --format json");
    std::thread::sleep(Duration::from_millis(100));
    done(ask(&daemon, "disconnect ticker.out"));
    done(ask(&daemon, "connect ticker.out listener.heard"));
    // The ticker is built anew, and counts from the beginning.
    profiles.replace("Ticker.xml", "<version>1.0</version>", "<version>1.1</version>");
    done(ask(&daemon, "reload"));
    let shown = done(finish(following)).json();
    assert_eq!(shown.len(), 400);
    let numbers: Vec<_> = shown.iter().map(|answer| answer["echo"]["value"]["number"].as_u64().unwrap()).collect();
    assert!(numbers.windows(2).any(|pair| pair[1] < pair[0]), "it began again");
}

#[test]
fn its_end_comes_with_its_port() {
    let profiles = pair();
    let daemon = Running::start(profiles.path(), &[]);
    let following = start(&daemon, "port echo listener.heard");
    std::thread::sleep(Duration::from_millis(100));
    profiles.write("app.xml", &application(&[slot("ticker", "Ticker", "")], &[]));
    done(ask(&daemon, "reload"));
    let ended = finish(following);
    assert!(ended.code == Some(6) && ended.err.contains("listener"), "{ended:?}");
}

#[test]
fn a_port_of_a_service_has_no_values() {
    let call = connection_of("service", "asker.tell -> teller.told", "");
    let profiles = Profiles::new(&application(&[slot("asker", "Asker", ""), slot("teller", "Teller", "")], &[&call]));
    profiles.describe(&plugin_dir().join("libqueries.so"));
    let daemon = Running::start(profiles.path(), &[]);
    let refused = ask(&daemon, "port echo asker.tell --count 1");
    assert!(refused.code == Some(6) && refused.err.contains("no data port"), "{refused:?}");
}

#[test]
fn plain_events_are_shown_and_other_event_ports_have_none() {
    let links = [
        connection_of("event", "chime.strikes -> watcher.alarms", ""),
        connection_of("event", "measurer.levels -> watcher.level", ""),
    ];
    let quiet = "<properties><property name=\"run\" type=\"string\">nothing</property></properties>";
    let slots = [slot("chime", "Chime", ""), slot("measurer", "Measurer", ""), slot("watcher", "Watcher", quiet)];
    let profiles = Profiles::new(&application(&slots, &links.each_ref().map(String::as_str)));
    profiles.describe(&plugin_dir().join("libevents.so"));
    let daemon = Running::start(profiles.path(), &[]);
    for port in ["chime.strikes", "watcher.alarms"] {
        let shown = done(ask(&daemon, &format!("port echo {port} --count 2 --format json"))).json();
        assert_eq!((shown.len(), &shown[0]["echo"]["from"]), (2, &json!("chime.strikes")), "{shown:?}");
        assert!(shown[0]["echo"]["value"].as_u64() < shown[1]["echo"]["value"].as_u64(), "{shown:?}");
        done(ask(&daemon, &format!("port hz {port} --window 0.1 --count 1")));
    }
    for port in ["measurer.levels", "watcher.level"] {
        for verb in ["echo", "hz"] {
            let refused = ask(&daemon, &format!("port {verb} {port} --count 1"));
            assert!(refused.code == Some(6) && refused.err.contains("is no data port"), "{refused:?}");
        }
    }
}

#[test]
fn a_port_tells_its_subscription_and_its_cycle() {
    let profiles = Profiles::new(&application(
        &[slot("hearer", "Hearer", ""), slot("sender", "Sender", "")],
        &["sender.auto -> hearer.auto", "sender.thin -> hearer.thin"],
    ));
    profiles.describe(&plugin_dir().join("libpushes.so"));
    let daemon = Running::start(profiles.path(), &[]);
    let port =
        |name: &str| done(ask(&daemon, &format!("port info {name} --format json"))).json().remove(0)["port"].clone();
    let (auto, thin, client) = (port("sender.auto"), port("sender.thin"), port("hearer.thin"));
    assert_eq!((&auto["period_ns"], &auto["running"]), (&json!(10_000_000), &json!(true)));
    assert_eq!((&thin["min_cycle_ns"], &thin["early"]), (&json!(3_600_000_000_000_u64), &json!(0)));
    assert_eq!((&client["every"], client.get("period_ns")), (&json!(0), None));
    let text = done(ask(&daemon, "port info sender.auto")).out;
    assert!(text.contains("running"), "{text}");
}
