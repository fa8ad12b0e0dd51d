//! Scenarios of the paper on the simulated robot: a stateful component goes on from its checkpoint, and a secondary with another
//! method takes over from a primary that fails again and again. The robot arrives and hits nothing.

use std::path::Path;
use std::process::Command;

use framework_daemon::fault::journal::unseal;
use serde_json::Value;
use tempfile::TempDir;
use tests::profiles::plugin_dir;

/// Drives to the target with these faults; what the journal says of the faults.
fn drive(inject: &[&str]) -> Vec<Value> {
    let scratch = TempDir::new().unwrap();
    let profile = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/navigation");
    let mut command = Command::new(plugin_dir().join("robot-demo"));
    command.args(["--headless", "--timeout", "300", "--profile"]).arg(profile).arg("--out").arg(scratch.path());
    inject.iter().for_each(|fault| _ = command.args(["--inject", fault]));
    let output = command.output().expect("the demo is built");
    let log = std::fs::read_to_string(scratch.path().join("daemon.log")).unwrap_or_default();
    assert!(output.status.success(), "{}\n{log}", String::from_utf8_lossy(&output.stdout));
    let journal = std::fs::read_to_string(scratch.path().join("journal.jsonl")).unwrap();
    let entries = journal.lines().filter_map(|line| unseal(&format!("{line}\n")));
    entries
        .filter(|entry| entry["kind"] == "fault" && entry["injected"] == true && entry["symptom"] != "late")
        .collect()
}

#[test]
fn the_odometry_keeps_its_pose_and_a_secondary_steers_on() {
    // Two resets are allowed: the third crash calls for the secondary.
    let crashes = ["avoider:crash.segv@4", "avoider:crash.segv@5", "avoider:crash.segv@6"];
    let faults = drive(&[&["odometry:crash.segv@3"], crashes.as_slice()].concat());
    let of = |slot: &str| faults.iter().filter(|fault| fault["slot"] == slot).cloned().collect::<Vec<_>>();
    let odometry = of("odometry");
    assert_eq!((odometry[0]["action"].as_str(), odometry[0]["outcome"].as_str()), (Some("reset"), Some("recovered")));
    assert!(odometry[0]["checkpoint"].as_u64().is_some(), "it went on from its checkpoint: {}", odometry[0]);
    let avoider = of("avoider");
    let told: Vec<_> = avoider.iter().map(|fault| fault["action"].as_str().unwrap()).collect();
    assert_eq!(told, ["reset", "reset", "replace"]);
    assert_eq!(avoider[2]["successor"], "AvoidanceSecondary");
}
