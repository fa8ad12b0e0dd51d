//! The latch of the emergency stop outlives whatever ends the daemon, and whatever happens to its file; only an operator takes
//! it back.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::Command;

use tests::asking::ask;
use tests::brakes::{RULES, Robot, robot};
use tests::profiles::slot;
use tests::running::Running;

const RAISE: &[&str] = &["--inject", "sensor:crash.segv@0.3"];

fn journal(robot: &Robot) -> PathBuf {
    robot.lines.path().join("state/journal.jsonl")
}

fn file(robot: &Robot) -> PathBuf {
    robot.lines.path().join("state/journal.jsonl.emergency")
}

fn run(robot: &Robot, arguments: &[&str]) -> Running {
    Running::spawn_on(&journal(robot), robot.profiles.path(), arguments).ready()
}

fn is_latched(daemon: &Running) -> bool {
    ask(daemon, "status --format json").json()[0]["emergency"] == true
}

/// Latched, with the fault that it is for on the disk.
fn raised(robot: &Robot, daemon: &Running) {
    daemon.until("its cause is written", || {
        fs::read_to_string(file(robot)).is_ok_and(|text| text.contains("crash.segv"))
    });
}

fn killed(mut daemon: Running) {
    daemon.signal("KILL");
    daemon.wait();
}

fn driven(robot: &Robot) -> usize {
    robot.line("left").iter().filter(|text| *text == "drive").count()
}

#[test]
fn it_stays_latched_until_an_operator_clears_it_whatever_ends_the_daemon() {
    let robot = robot(RULES, "");
    let daemon = run(&robot, RAISE);
    raised(&robot, &daemon);
    killed(daemon);
    // Killed, crashed, ended in order.
    for (arguments, ends) in [(&[][..], "KILL"), (&["--inject", "daemon:crash.segv@0.3"], ""), (&[], "TERM")] {
        let before = driven(&robot);
        let mut daemon = run(&robot, arguments);
        daemon.wait_for("the run before left it latched for crash.segv of sensor (fault ");
        daemon.wait_for("left (held: emergency stop)");
        assert_eq!(robot.line("left").last().map(String::as_str), Some("stop"), "its outputs are safe");
        assert_eq!(daemon.entries("emergency").last().unwrap()["step"], "restored");
        if ends.is_empty() {
            daemon.wait();
        } else {
            let status = ask(&daemon, "status");
            assert!(status.out.starts_with("EMERGENCY STOP latched for crash.segv of sensor (fault "), "{status:?}");
            assert_eq!(ask(&daemon, "component start left").code, Some(7));
            daemon.signal(ends);
            daemon.wait();
        }
        assert_eq!(driven(&robot), before, "{ends}");
    }
    let mut daemon = run(&robot, &[]);
    let cleared = ask(&daemon, "fault clear").out;
    assert!(cleared.starts_with("the emergency stop for crash.segv of sensor (fault "), "{cleared}");
    assert!(cleared.ends_with(" is cleared\nleft: active\nright: active\n"), "{cleared}");
    daemon.until("the wheels turn again", || robot.line("left").last().is_some_and(|text| text == "drive"));
    daemon.stop();
    assert!(!is_latched(&run(&robot, &[])));
}

#[test]
fn a_fresh_run_forgets_it_and_says_so_but_not_one_that_is_refused() {
    let robot = robot(RULES, "");
    let mut daemon = run(&robot, RAISE);
    raised(&robot, &daemon);
    daemon.stop();
    let sound = fs::read_to_string(robot.profiles.path().join("app.xml")).unwrap();
    robot.profiles.write("app.xml", &sound.replace("Brake", "NoSuchClass"));
    let mut refused = Running::spawn_on(&journal(&robot), robot.profiles.path(), &["--fresh"]);
    assert!(!refused.wait().success());
    robot.profiles.write("app.xml", &sound);
    let again = run(&robot, &[]);
    assert!(is_latched(&again), "{}", again.log());
    killed(again);
    let daemon = run(&robot, &["--fresh"]);
    assert!(!is_latched(&daemon));
    daemon.wait_for("the emergency stop is forgotten, as --fresh says; the run before left it latched for crash.segv");
    let line = daemon.entries("emergency").pop().unwrap();
    assert_eq!((line["step"].as_str(), line["left"]["cause"]["slot"].as_str()), (Some("forgotten"), Some("sensor")));
    daemon.until("the wheels turn", || robot.line("left").last().is_some_and(|text| text == "drive"));
    killed(daemon);
    assert!(!is_latched(&run(&robot, &[])));
}

/// What may lie where the file should.
fn spoil(path: &Path, how: &str) {
    let _ = fs::remove_file(path);
    match how {
        "a directory" => fs::create_dir(path).unwrap(),
        "a pipe" => assert!(Command::new("mkfifo").arg(path).status().unwrap().success()),
        "a link to nowhere" => std::os::unix::fs::symlink("nowhere/at/all", path).unwrap(),
        "a link to a device" => std::os::unix::fs::symlink("/dev/full", path).unwrap(),
        text => fs::write(path, text).unwrap(),
    }
}

#[test]
fn a_file_that_nobody_can_read_counts_as_latched() {
    let robot = robot(RULES, "");
    killed(run(&robot, &[]));
    for how in ["", "not latched\n", "a pipe", "a link to nowhere", "a link to a device", "a directory"] {
        spoil(&file(&robot), how);
        let before = driven(&robot);
        let daemon = run(&robot, &[]);
        daemon.wait_for("EMERGENCY STOP: nobody can tell whether the run before left it latched: ");
        assert!(is_latched(&daemon), "{how}");
        assert_eq!(driven(&robot), before, "{how}");
        let cleared = ask(&daemon, "fault clear").out;
        assert!(cleared.ends_with("\nleft: active\nright: active\n"), "{how}: {cleared}");
        assert_eq!(cleared.contains("the next run may come up latched"), how == "a directory", "{cleared}");
        if how == "a directory" {
            let status = ask(&daemon, "status");
            assert!(status.out.contains("an emergency stop would not outlive the daemon: "), "{status:?}");
            fs::remove_dir(file(&robot)).unwrap();
            daemon.wait_for("an emergency stop outlives the daemon again");
        }
        killed(daemon);
        let next = run(&robot, &[]);
        assert!(!is_latched(&next), "{how}");
        killed(next);
    }
}

#[test]
fn a_file_that_somebody_removed_is_made_anew() {
    let robot = robot(RULES, "");
    let daemon = run(&robot, RAISE);
    fs::remove_file(file(&robot)).unwrap();
    raised(&robot, &daemon);
    killed(daemon);
    assert!(is_latched(&run(&robot, &[])));
}

#[test]
fn a_file_that_somebody_removed_between_two_runs_is_missed() {
    let robot = robot(RULES, "");
    let daemon = run(&robot, RAISE);
    raised(&robot, &daemon);
    killed(daemon);
    fs::remove_file(file(&robot)).unwrap();
    let before = driven(&robot);
    let daemon = run(&robot, &[]);
    daemon.wait_for("nobody can tell whether the run before left it latched: ");
    assert!(is_latched(&daemon) && driven(&robot) == before);
    assert_eq!(ask(&daemon, "fault clear").code, Some(0));
    killed(daemon);
    fs::remove_file(file(&robot)).unwrap();
    assert!(!is_latched(&run(&robot, &[])), "it was taken back");
}

#[test]
fn what_somebody_writes_into_it_is_written_over() {
    let robot = robot(RULES, "");
    let mut daemon = run(&robot, &["--inject", "sensor:crash.segv@0.5"]);
    let old = fs::read(file(&robot)).unwrap();
    raised(&robot, &daemon);
    for (count, bytes) in [&b""[..], &old].into_iter().enumerate() {
        fs::write(file(&robot), bytes).unwrap();
        let line = daemon.journal("latch", count + 1).pop().unwrap();
        assert_eq!((&line["found"], &line["file"]), (&"somebody wrote into it".into(), &file(&robot).to_str().into()));
        assert!(fs::read_to_string(file(&robot)).unwrap().contains("crash.segv"), "it is what it was");
    }
    fs::remove_file(file(&robot)).unwrap();
    daemon.wait_for("somebody moved or removed it; it says again what is so");
    killed(daemon);
    let next = run(&robot, &[]);
    next.wait_for("the run before left it latched for crash.segv of sensor (fault ");
    daemon = next;
    assert_eq!(ask(&daemon, "fault clear").code, Some(0));
    // What is not latched is not to be found latched.
    spoil(&file(&robot), "");
    let line = daemon.journal("latch", 4).pop().unwrap();
    assert_eq!(line["found"], "somebody moved or removed it");
    killed(daemon);
    assert!(!is_latched(&run(&robot, &[])));
}

#[test]
fn what_it_is_raised_for_again_is_told_with_the_first() {
    let robot = robot(RULES, "");
    let rules = slot("other", "Witness", RULES);
    robot.profiles.replace("app.xml", "</subcomponents>", &format!("{rules}</subcomponents>"));
    let daemon = run(&robot, &["--inject", "sensor:crash.segv@0.3", "--inject", "other:crash.panic@0.6"]);
    daemon
        .until("both are written", || fs::read_to_string(file(&robot)).is_ok_and(|text| text.contains("crash.panic")));
    let roots: Vec<_> = daemon.journal("fault", 2).iter().map(|fault| fault["seq"].clone()).collect();
    let raised = || daemon.entries("emergency").into_iter().filter(|line| line["step"] == "raised");
    daemon.until("both are told", || raised().count() == 2);
    assert_eq!(raised().map(|line| line["root"].clone()).collect::<Vec<_>>(), roots, "each of its own fault");
    killed(daemon);
    let daemon = run(&robot, &[]);
    let told = |text: &str| {
        let both = text
            .split_once(" for crash.segv of sensor (fault ")
            .and_then(|(_, rest)| rest.split_once("raised again for "));
        assert!(both.is_some_and(|(_, again)| again.starts_with("crash.panic of other (fault ")), "{text}");
    };
    told(&daemon.log());
    told(&ask(&daemon, "status").out);
    told(&ask(&daemon, "fault clear").out);
}

#[test]
fn where_it_cannot_be_kept_that_is_told_and_tried_again() {
    let robot = robot(RULES, "");
    let daemon = run(&robot, RAISE);
    let (here, away) = (robot.lines.path().join("state"), robot.lines.path().join("away"));
    fs::rename(&here, &away).unwrap();
    daemon.wait_for("an emergency stop would not outlive the daemon: ");
    let status = ask(&daemon, "status --format json").json().remove(0);
    assert_eq!((&status["emergency"], &status["latch"]["kept"]), (&true.into(), &false.into()), "{status}");
    fs::rename(&away, &here).unwrap();
    daemon.wait_for("an emergency stop outlives the daemon again");
    killed(daemon);
    assert!(is_latched(&run(&robot, &[])));
}

#[test]
fn a_restart_for_suspect_memory_comes_up_latched() {
    let robot = robot(RULES, "");
    robot.profiles.replace("system.xml", "<system_profile>", "<system_profile on_taint=\"restart\">");
    let rules = format!("<properties><property name=\"how\" type=\"string\">corrupt</property></properties>{RULES}");
    let wild = slot("wild", "Stuck", &rules);
    robot.profiles.replace("app.xml", "</subcomponents>", &format!("{wild}</subcomponents>"));
    let mut daemon = Running::spawn_on(&journal(&robot), robot.profiles.path(), &[]);
    assert_eq!(daemon.wait().code(), Some(1), "its supervisor is to start it anew");
    let before = driven(&robot);
    robot.profiles.replace("app.xml", &wild, "");
    let mut next = run(&robot, &[]);
    next.wait_for("the run before left it latched for crash.abort of wild (fault ");
    assert!(is_latched(&next) && driven(&robot) == before);
    next.stop();
}

#[test]
fn one_journal_is_one_daemons() {
    let robot = robot(RULES, "");
    let daemon = run(&robot, RAISE);
    raised(&robot, &daemon);
    let mut other = Running::spawn_on(&journal(&robot), robot.profiles.path(), &["--fresh"]);
    assert!(!other.wait().success());
    let told = format!("another daemon (process {}) writes it: name another one with --journal FILE", daemon.pid());
    other.wait_for(&told);
    killed(daemon);
    assert!(is_latched(&run(&robot, &[])));
}

#[test]
fn a_journal_that_is_moved_away_leaves_its_place_to_nobody_else() {
    let robot = robot(RULES, "");
    let daemon = run(&robot, RAISE);
    raised(&robot, &daemon);
    let places = ["journal.jsonl", "journal.jsonl.lock"].map(|name| robot.lines.path().join("state").join(name));
    for moved in [&places[..1], &places[..]] {
        moved.iter().for_each(|path| fs::rename(path, path.with_extension("1")).unwrap());
        // Where all of it is gone somebody has to look, which the daemon does every second.
        daemon.until("its lock is back", || places[1].exists());
        let mut other = Running::spawn_on(&journal(&robot), robot.profiles.path(), &["--fresh"]);
        assert!(!other.wait().success());
        other.wait_for(&format!("another daemon (process {}) writes it", daemon.pid()));
        assert_eq!(ask(&daemon, "component stop idle").code, Some(0));
        assert_eq!(daemon.journal("order", 1).len(), 1, "it goes on at its place");
    }
    killed(daemon);
    assert!(is_latched(&run(&robot, &[])));
}

#[test]
fn a_journal_has_one_latch_by_whatever_name_it_is_called() {
    let robot = robot(RULES, "");
    let (state, link) = (robot.lines.path().join("state"), robot.lines.path().join("link.jsonl"));
    fs::create_dir(&state).unwrap();
    // Before there is a journal, too.
    std::os::unix::fs::symlink("state/journal.jsonl", &link).unwrap();
    let daemon = Running::spawn_on(&link, robot.profiles.path(), RAISE).ready();
    raised(&robot, &daemon);
    let mut other = Running::spawn_on(&journal(&robot), robot.profiles.path(), &[]);
    assert!(!other.wait().success());
    killed(daemon);
    let daemon = run(&robot, &[]);
    assert!(is_latched(&daemon));
    killed(daemon);
    // A link that leads elsewhere every day.
    fs::remove_file(&link).unwrap();
    std::os::unix::fs::symlink("state/tomorrow.jsonl", &link).unwrap();
    let before = driven(&robot);
    let daemon = Running::spawn_on(&link, robot.profiles.path(), &[]).ready();
    daemon.wait_for("the run before left it latched for crash.segv of sensor (fault ");
    assert!(is_latched(&daemon) && driven(&robot) == before);
    assert_eq!(ask(&daemon, "fault clear").code, Some(0));
    killed(daemon);
    assert!(!is_latched(&Running::spawn_on(&link, robot.profiles.path(), &[]).ready()));
}

/// Where the latch's companion lies in memory.
fn companion(robot: &Robot) -> Option<PathBuf> {
    let name = file(robot).canonicalize().unwrap().into_os_string().into_encoded_bytes();
    let user = fs::metadata(robot.lines.path()).unwrap().uid();
    let all = fs::read_dir(format!("/dev/shm/framework-daemon-{user}")).into_iter().flatten().flatten();
    let says = |path: &PathBuf| fs::read(path).is_ok_and(|text| text.windows(name.len()).any(|part| part == name));
    all.map(|entry| entry.path()).find(says)
}

#[test]
fn a_kill_before_the_disk_knew_loses_nothing_but_by_a_reboot() {
    let robot = robot(RULES, "");
    let daemon = run(&robot, RAISE);
    let old = fs::read(file(&robot)).unwrap();
    raised(&robot, &daemon);
    killed(daemon);
    // As if the disk had not been written by then.
    fs::write(file(&robot), &old).unwrap();
    let before = driven(&robot);
    let daemon = run(&robot, &[]);
    assert!(is_latched(&daemon) && driven(&robot) == before, "{}", daemon.log());
    killed(daemon);
    let text = fs::read_to_string(file(&robot)).unwrap();
    assert!(text.starts_with("{\"latched\":true"), "now the disk knows");
    fs::remove_file(companion(&robot).unwrap()).unwrap();
    let mut daemon = run(&robot, &[]);
    assert!(is_latched(&daemon));
    assert_eq!(ask(&daemon, "fault clear").code, Some(0));
    daemon.stop();
    assert_eq!(companion(&robot), None, "an end in order leaves nothing there");
    assert!(!is_latched(&run(&robot, &[])));
}
