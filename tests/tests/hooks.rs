//! Faults in every callback but `on_execute`: contained, blamed, answered; the others go on.

use tests::profiles::{Profiles, application, plugin_dir, slot};
use tests::running::Running;

/// A slot that fails in `hook`, beside one that must not notice.
fn doomed(hook: &str, how: &str, bait: bool) -> Profiles {
    let inside = format!(
        "<properties><property name=\"hook\" type=\"string\">{hook}</property><property name=\"how\" type=\"string\">{how}</property>\
         <property name=\"bait\" type=\"bool\">{bait}</property></properties>\
         <fault_tolerance><severity>reset</severity><reset limit=\"2\" within=\"60s\"/></fault_tolerance>"
    );
    let profiles = Profiles::new(&application(&[slot("doomed", "Doomed", &inside), slot("ticker", "Ticker", "")], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    profiles
}

const HOW: [&str; 3] = ["panic", "segv", "error"];

/// What the journal says of the first `count` faults, and that nobody but `doomed` had any.
fn actions(hook: &str, how: &str, count: usize) -> Vec<String> {
    let mut daemon = Running::start(doomed(hook, how, false).path(), &[]);
    let faults = daemon.journal("fault", count);
    assert!(faults.iter().all(|fault| fault["slot"] == "doomed"), "{hook} {how}");
    let slots = daemon.stop();
    assert_eq!((slots[1]["state"].as_str(), slots[1]["faults"].as_u64()), (Some("active"), Some(0)), "{hook} {how}");
    faults.iter().map(|fault| fault["action"].as_str().unwrap_or_default().to_owned()).collect()
}

#[test]
fn a_fault_in_update_is_reset_within_the_intensity_then_the_slot_stops() {
    for how in HOW {
        assert_eq!(actions("update", how, 3), ["reset", "reset", "stop"], "{how}");
    }
}

/// What never started is started again after its reset, and fails again.
#[test]
fn a_fault_in_start_is_not_taken_for_recovered() {
    for how in HOW {
        let mut daemon = Running::start(doomed("start", how, false).path(), &[]);
        let faults = daemon.journal("fault", 2);
        let outcomes: Vec<_> = faults.iter().map(|fault| fault["outcome"].as_str().unwrap()).collect();
        assert_eq!(outcomes, ["failed", "stopped"], "{how}");
        let slots = daemon.stop();
        assert_eq!((slots[0]["state"].as_str(), slots[0]["missed"].as_u64()), (Some("error"), Some(0)), "{how}");
    }
}

#[test]
fn a_fault_in_a_callback_after_a_fault_goes_one_step_further() {
    for (hook, how) in ["error", "reset", "recover"].iter().flat_map(|hook| HOW.map(|how| (*hook, how))) {
        let mut daemon = Running::start(doomed(hook, how, true).path(), &[]);
        let faults = daemon.journal("fault", 2);
        let outcomes: Vec<_> = faults.iter().map(|fault| fault["outcome"].as_str().unwrap()).collect();
        assert_eq!(outcomes, ["failed", "stopped"], "{hook} {how}");
        let slots = daemon.stop();
        assert_eq!(slots[0]["faults"], 2, "{hook} {how}: the second fault is counted");
        assert_eq!(
            (slots[1]["state"].as_str(), slots[1]["faults"].as_u64()),
            (Some("active"), Some(0)),
            "{hook} {how}"
        );
    }
}

#[test]
fn a_fault_on_the_way_out_does_not_keep_the_others_from_ending_in_order() {
    for (hook, how) in ["stop", "destroy", "drop"].iter().flat_map(|hook| HOW.map(|how| (*hook, how))) {
        let mut daemon = Running::start(doomed(hook, how, false).path(), &[]);
        let slots = daemon.stop();
        assert_eq!(slots.len(), 2, "{hook} {how}");
    }
}

#[test]
fn a_constructor_or_initialize_that_fails_refuses_the_boot_and_names_the_slot() {
    for how in HOW {
        let profiles = doomed("initialize", how, false);
        let mut daemon = Running::spawn(profiles.path(), &[]);
        assert_eq!(daemon.wait().code(), Some(1), "{how}");
        daemon.wait_for("slot doomed: its instance cannot be initialised");
    }
    let profiles = Profiles::new(&application(&[slot("child", "Stillborn", "")], &[]));
    profiles.describe(&plugin_dir().join("libhostile.so"));
    let mut daemon = Running::spawn(profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(1));
    daemon.wait_for("slot child: its instance cannot be initialised: crash.segv");
}
