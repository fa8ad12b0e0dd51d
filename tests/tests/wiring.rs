//! A component that wires others while they run: nothing else is disturbed, and what does not fit is refused in words.

use tests::profiles::{Profiles, application, slot};
use tests::running::Running;

/// Two writers, a reader, and a switch for these writers.
fn switching(writers: &str) -> Profiles {
    let first = |label: &str, number: u64| {
        format!(
            "<properties><property name=\"label\" type=\"string\">{label}</property>\
             <property name=\"first\" type=\"long\">{number}</property></properties>"
        )
    };
    let writers = format!("<properties><property name=\"writers\" type=\"string\">{writers}</property></properties>");
    let slots = [
        slot("one", "Ticker", &first("one", 0)),
        slot("two", "Ticker", &first("two", 500_000)),
        slot("listener", "Listener", ""),
        slot("steady", "Listener", ""),
        slot("switch", "Switch", &writers),
        slot("diary", "Diary", ""),
    ];
    Profiles::new(&application(&slots, &["one.out -> listener.heard", "one.out -> steady.heard"]))
}

#[test]
fn a_component_rewires_others_and_misses_nothing_that_stays_connected() {
    // Uneven, so that the hundredth values that are told of come from both.
    let profiles = switching("one.out two.out two.out");
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("connected listener.heard and two.out");
    // The steady one has heard every number from the first one, whatever happened beside it.
    daemon.wait_for("steady: heard 301 of 300 from one");
    daemon.wait_for("from two");
    daemon.wait_for("listener: heard 1 of");
    let slots = daemon.stop();
    for slot in &slots {
        assert_eq!(slot["faults"], 0, "{slot}");
    }
    let missed: u64 = slots.iter().filter_map(|slot| slot["missed"].as_u64()).sum();
    let cycles: u64 = slots.iter().filter_map(|slot| slot["cycles"].as_u64()).sum();
    // The machine may be busy; what wires at run time must not make others late.
    assert!(missed * 10 < cycles, "{missed} of {cycles}");
}

#[test]
fn what_does_not_fit_is_refused_in_words_that_name_both_sides() {
    let profiles = switching("nobody.out one.none listener.heard steady.heard");
    let mut daemon = Running::start(profiles.path(), &[]);
    for text in [
        "ServiceUnavailable: listener.heard cannot be connected to nobody.out: there is no slot nobody with ports",
        "ServiceUnavailable: listener.heard cannot be connected to one.none: slot one has no port none",
        "IncompatibleService: listener.heard and steady.heard cannot be connected: each is an input, and none of them writes",
    ] {
        daemon.wait_for(text);
    }
    let slots = daemon.stop();
    assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
}
