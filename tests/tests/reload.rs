//! SIGHUP: all or nothing, and only what changed is touched.

use std::path::Path;

use tests::profiles::{Profiles, application, connection, slot};
use tests::running::Running;

fn pair() -> Profiles {
    Profiles::new(&application(
        &[slot("ticker", "Ticker", ""), slot("listener", "Listener", ""), slot("diary", "Diary", "")],
        &["ticker.out -> listener.heard"],
    ))
}

#[test]
fn only_what_changed_is_touched() {
    let profiles = pair();
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("heard 101");
    let extra =
        slot("second", "Ticker", "<properties><property name=\"label\" type=\"string\">second</property></properties>");
    profiles.replace("app.xml", "</subcomponents>", &format!("{extra}</subcomponents>"));
    profiles.replace(
        "app.xml",
        "</port_connections>",
        &format!("{}</port_connections>", connection("second.out -> listener.heard", "")),
    );
    daemon.signal("HUP");
    let reload = daemon.journal("reload", 1).remove(0);
    assert_eq!((reload["accepted"].as_bool(), reload["kept"].as_u64()), (Some(true), Some(3)));
    assert_eq!(reload["added"], serde_json::json!(["second"]));
    daemon.wait_for("from second");
    let before = daemon.lines("heard ").len();
    daemon.wait_for_lines("heard ", before + 3);
    let slots = daemon.stop();
    assert_eq!(daemon.lines("ticker: starts").len(), 1, "the kept slot was not started again");
    assert_eq!(daemon.lines("diary: hook initialize").len(), 1);
    assert!(slots[0]["cycles"].as_u64() > Some(100), "its counter went on");
}

#[test]
fn a_changed_property_builds_its_slot_anew_and_a_removed_slot_ends() {
    let profiles = pair();
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.wait_for("heard 1 ");
    let inside = "<properties><property name=\"first\" type=\"int\">5000</property></properties>";
    profiles.replace("app.xml", &slot("ticker", "Ticker", ""), &slot("ticker", "Ticker", inside));
    profiles.replace("app.xml", &slot("diary", "Diary", ""), "");
    daemon.signal("HUP");
    let reload = daemon.journal("reload", 1).remove(0);
    assert_eq!(reload["changed"], serde_json::json!(["ticker"]));
    assert_eq!(reload["removed"], serde_json::json!(["diary"]));
    daemon.wait_for("ticker: starts at 5000");
    daemon.wait_for("diary: hook destroy");
    daemon.wait_for(" of 5");
    let slots = daemon.stop();
    assert_eq!(slots.len(), 2);
}

#[test]
fn a_plugin_that_cannot_be_loaded_changes_nothing() {
    let profiles = pair();
    let mut daemon = Running::start(profiles.path(), &[]);
    profiles.replace("Relay.xml", "libbasic.so", "libabsent.so");
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("relay", "Relay", "")));
    daemon.signal("HUP");
    let reload = daemon.journal("reload", 1).remove(0);
    assert_eq!(reload["accepted"], false);
    let seen = daemon.lines("heard ").len();
    daemon.wait_for_lines("heard ", seen + 2);
    assert_eq!(daemon.stop().len(), 3);
}

/// Every broken profile of `profiles/broken`, one after the other, into one running daemon.
#[test]
fn no_broken_profile_disturbs_a_running_daemon() {
    let profiles = pair();
    let mut daemon = Running::start(profiles.path(), &[]);
    let good: Vec<_> = files(profiles.path());
    let broken = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/broken");
    let mut kinds: Vec<_> =
        std::fs::read_dir(broken).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir()).collect();
    kinds.sort();
    assert!(kinds.len() >= 40, "only {} kinds", kinds.len());
    for (number, kind) in kinds.iter().enumerate() {
        files(profiles.path()).iter().for_each(|(path, _)| std::fs::remove_file(path).unwrap());
        copy(kind, profiles.path());
        daemon.signal("HUP");
        let reload = daemon.journal("reload", number + 1).remove(number);
        assert_eq!(reload["accepted"], false, "{}", kind.display());
        assert!(reload["reasons"][0].as_str().is_some_and(|reason| !reason.is_empty()), "{}", kind.display());
    }
    files(profiles.path()).iter().for_each(|(path, _)| std::fs::remove_file(path).unwrap());
    good.iter().for_each(|(path, text)| std::fs::write(path, text).unwrap());
    daemon.signal("HUP");
    let last = daemon.journal("reload", kinds.len() + 1).pop().unwrap();
    assert_eq!((last["accepted"].as_bool(), last["kept"].as_u64()), (Some(true), Some(3)));
    daemon.stop();
    assert_eq!(daemon.lines("ticker: starts").len(), 1);
}

fn files(directory: &Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let entries = std::fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.is_file()).map(|path| (path.clone(), std::fs::read(&path).unwrap())).collect()
}

fn copy(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
        if entry.path().is_dir() {
            let inner = to.join(entry.file_name());
            let _ = std::fs::create_dir(&inner);
            copy(&entry.path(), &inner);
        } else {
            std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
}
