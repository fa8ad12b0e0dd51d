//! A skill re-wires the navigation robot while it drives, through the real daemon, against the simulator.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use framework_daemon::fault::journal::unseal;
use serde_json::Value;
use tempfile::TempDir;
use tests::profiles::plugin_dir;

/// What a drive left behind.
struct Drive {
    /// Who drove, in the order of time.
    drivers: Vec<String>,
    /// Periods that each slot missed, where it missed any.
    missed: BTreeMap<String, u64>,
    picture: String,
}

/// Drives to the target, the avoiders taking turns of that many seconds.
fn drive(each: &str) -> Drive {
    let scratch = TempDir::new().unwrap();
    let profile = scratch.path().join("profile");
    std::fs::create_dir(&profile).unwrap();
    let original = Path::new(env!("CARGO_MANIFEST_DIR")).join("../profiles/navigation_skill");
    for file in std::fs::read_dir(original).unwrap().map(Result::unwrap) {
        let text = std::fs::read_to_string(file.path()).unwrap();
        let wanted = format!("<property name=\"each\" type=\"double\">{each}</property>");
        let text = text.replace("<property name=\"each\" type=\"double\">2.0</property>", &wanted);
        std::fs::write(profile.join(file.file_name()), text).unwrap();
    }
    let out = scratch.path().join("out");
    let mut command = Command::new(plugin_dir().join("robot-demo"));
    command.args(["--headless", "--faults", "none", "--timeout", "300"]);
    let output = command.arg("--profile").arg(&profile).arg("--out").arg(&out).output().expect("the demo is built");
    let log = std::fs::read_to_string(out.join("daemon.log")).unwrap_or_default();
    let said = String::from_utf8_lossy(&output.stdout);
    // It arrived, hit nothing, and nothing failed: a fault would have to be recovered from, and is none here.
    let last = said.lines().last().unwrap_or_default();
    let is_good = output.status.success() && last.contains("faults 0, recovered 0, collisions 0");
    assert!(is_good, "{said}\n{}\n{log}", String::from_utf8_lossy(&output.stderr));
    let journal = std::fs::read_to_string(out.join("journal.jsonl")).unwrap();
    let entries: Vec<Value> = journal.lines().filter_map(|line| unseal(&format!("{line}\n"))).collect();
    let stop = entries.iter().find(|entry| entry["kind"] == "stop").expect("it ended in order");
    let slots = stop["slots"].as_array().unwrap();
    assert!(slots.iter().all(|slot| slot["faults"] == 0), "{slots:?}");
    let missed = slots.iter().map(|slot| (slot["slot"].as_str().unwrap().to_owned(), slot["missed"].as_u64().unwrap()));
    let drivers = log.lines().filter_map(|line| line.split_once(" drives from ")?.0.rsplit(' ').next());
    Drive {
        drivers: drivers.map(str::to_owned).collect(),
        missed: missed.filter(|(_, missed)| *missed > 0).collect(),
        picture: std::fs::read_to_string(out.join("path.svg")).unwrap(),
    }
}

/// A busy machine makes components miss periods, whoever is wired to whom. So a drive without a miss shows that re-wiring
/// costs none; where there is no such drive, one in which nobody is re-wired must miss periods, too.
#[test]
fn the_avoiders_take_turns_while_the_robot_drives_and_nobody_misses_a_period() {
    let mut missed = Vec::new();
    for _ in 0..3 {
        let drive = drive("2.0");
        assert!(drive.drivers.len() >= 5, "{:?}", drive.drivers);
        let turns = ["avoider_a", "avoider_b"].into_iter().cycle();
        assert!(drive.drivers.iter().zip(turns).all(|(who, turn)| who == turn), "{:?}", drive.drivers);
        assert!(["avoider_a", "avoider_b"].iter().all(|name| drive.picture.contains(name)));
        if drive.missed.is_empty() {
            return;
        }
        missed.push(drive.missed);
    }
    let control = drive("100000");
    assert_eq!(control.drivers, ["avoider_a"]);
    assert!(!control.missed.is_empty(), "only where it is re-wired somebody misses periods: {missed:?}");
    eprintln!("this machine is too busy to show it: {missed:?}, and {:?} without re-wiring", control.missed);
}
