//! Data on its way: chains, queues, validity.

use tests::profiles::{Profiles, application, connection, slot};
use tests::running::Running;

fn chain(executor: &str) -> String {
    application(
        &[
            slot("listener", "Listener", executor),
            slot("relay", "Relay", executor),
            slot(
                "ticker",
                "Ticker",
                &format!("{executor}<properties><property name=\"first\" type=\"int\">7</property></properties>"),
            ),
        ],
        &["ticker.out -> relay.heard", "relay.said -> listener.heard"],
    )
}

#[test]
fn a_chain_over_three_executors_loses_nothing() {
    let profiles = Profiles::new(&chain(""));
    let fifo = "<queueing_policy>FIFO</queueing_policy><queue_size>500</queue_size><overflow>fault</overflow>";
    profiles.replace("Relay.xml", "<queueing_policy>LAST</queueing_policy>", fifo);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("heard 101 of 107 from ticker");
    daemon.wait_for("heard 301 of 307 from ticker");
    daemon.stop();
}

#[test]
fn a_chain_on_one_executor_runs_inline() {
    let profiles = Profiles::new(&chain("<executor>main</executor>"));
    profiles.executors(&["main"]);
    let mut daemon = Running::start(profiles.path(), &[]);
    assert!(daemon.log().contains("3 slots on 1 executors"), "{}", daemon.log());
    daemon.wait_for("heard 301 of 307 from ticker");
    let slots = daemon.stop();
    // What the last cycle wrote, it also passed on: the chain belongs to the cycle.
    let cycles = |name: &str| slots.iter().find(|slot| slot["slot"] == name).map(|slot| slot["cycles"].clone());
    assert_eq!(cycles("ticker"), cycles("relay"));
    assert_eq!(cycles("ticker"), cycles("listener"));
}

#[test]
fn a_reader_that_takes_one_of_several_is_called_for_each() {
    let main = "<executor>main</executor>";
    let slots = [slot("burst", "Burst", main), slot("nibbler", "Nibbler", main)];
    let profiles = Profiles::new(&application(&slots, &["burst.out -> nibbler.heard"]));
    profiles.executors(&["main"]);
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("nibbled 300 of 300");
}

#[test]
fn processors_that_are_not_there_are_told_and_do_not_stop_it() {
    let profiles = Profiles::new(&chain("<executor>main</executor>"));
    profiles
        .write("system.xml", "<system_profile><name>one</name><executor name=\"main\" cpu=\"1000\"/></system_profile>");
    let daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("executor main: processors [1000] cannot be used");
    daemon.wait_for("heard 101");
}

/// What the gauge heard of the sonar's readings, every tenth of which is bad, on one executor, so that none is overtaken.
struct Heard {
    sent: u64,
    good: u64,
    zeros: u64,
    faults: Vec<serde_json::Value>,
}

fn sonar(on_invalid: &str) -> Heard {
    let validity = format!(
        "<validity field=\"range\"><min>0.03</min><max>3.0</max><on_invalid>{on_invalid}</on_invalid></validity>"
    );
    let main = "<executor>main</executor>";
    let application = application(&[slot("gauge", "Gauge", main), slot("sonar", "Sonar", main)], &[]);
    let wired = connection("sonar.out -> gauge.heard", &validity);
    let profiles = Profiles::new(&application.replace("<port_connections>", &format!("<port_connections>{wired}")));
    profiles.executors(&["main"]);
    let mut daemon = Running::start(profiles.path(), &[]);
    let faults = daemon.journal("fault", 5);
    let slots = daemon.stop();
    let sent = slots.iter().find(|slot| slot["slot"] == "sonar").and_then(|slot| slot["cycles"].as_u64());
    let line = daemon.lines("gauge: good").remove(0);
    let number = |after: &str| {
        line.split(after).nth(1).and_then(|rest| rest.split_whitespace().next()).and_then(|word| word.parse().ok())
    };
    Heard { sent: sent.unwrap(), good: number("good ").unwrap(), zeros: number("zeros ").unwrap(), faults }
}

#[test]
fn a_bad_value_is_dropped_and_its_writer_blamed() {
    let heard = sonar("drop");
    assert_eq!((heard.good, heard.zeros), (heard.sent - heard.sent / 10, 0));
    for fault in &heard.faults {
        assert_eq!((fault["slot"].as_str(), fault["symptom"].as_str()), (Some("sonar"), Some("validity")));
        assert_eq!((fault["outcome"].as_str(), fault["evidence"]["value"].as_f64()), (Some("ignored"), Some(0.0)));
    }
}

#[test]
fn a_bad_value_is_replaced_by_the_last_good_one() {
    let heard = sonar("hold");
    assert_eq!((heard.good, heard.zeros), (heard.sent, 0));
}

#[test]
fn a_bad_value_is_passed_where_the_profile_says_so() {
    let heard = sonar("pass");
    assert_eq!((heard.good, heard.zeros), (heard.sent - heard.sent / 10, heard.sent / 10));
}
