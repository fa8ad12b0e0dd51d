//! What the command line says of what is not there, or is something else than was thought; and that it ends when nobody reads.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use tests::asking::{Answer, ask, finish, start, verb};
use tests::daemon_binary::daemon_binary;
use tests::profiles::{Profiles, application, slot};
use tests::running::Running;
use tests::sonars::robot;

fn refused(daemon: &Running, words: &str) -> String {
    let Answer { code, out, err } = ask(daemon, words);
    assert_eq!((code, out.as_str()), (Some(6), ""), "{words}: {err}");
    err.trim().strip_prefix("refused by the daemon: ").unwrap().to_owned()
}

fn sonars(slots: &[String], connections: &[&str]) -> Running {
    let profiles = robot(["7"; 3], "", ">", slots, connections);
    Running::start(profiles.path(), &[])
}

#[test]
fn where_nothing_is_connected_there_is_nothing_to_disconnect() {
    let daemon = sonars(&[slot("ear", "Ear", "")], &["sonar.out -> ear.heard"]);
    let told = refused(&daemon, "disconnect left.out");
    assert_eq!(
        told,
        "`left.out` has no connection: there is nothing to disconnect; sonar hears it, as the profiles say"
    );
    assert_eq!(ask(&daemon, "disconnect ear.heard").code, Some(0));
    let told = refused(&daemon, "disconnect ear.heard");
    assert_eq!(told, "`ear.heard` has no connection: there is nothing to disconnect");
    assert!(refused(&daemon, "disconnect ear.herd").contains("slot ear has no port herd"));
    assert_eq!(ask(&daemon, "connect ear.heard left.out").code, Some(0));
    assert_eq!(ask(&daemon, "disconnect left.out").out, "disconnected left.out\n");
}

#[test]
fn a_rate_is_measured_by_the_voter_where_nobody_else_hears() {
    let daemon = sonars(&[slot("ear", "Ear", "")], &["left.out -> ear.heard"]);
    let rate = |port: &str| {
        let answer = ask(&daemon, &format!("port hz {port} --window 0.5 --count 1 --format json"));
        assert_eq!(answer.code, Some(0), "{answer:?}");
        answer.json().remove(0)["rate"].clone()
    };
    let heard = rate("middle.out");
    assert_eq!(heard["measured_at"], "sonar");
    assert!(heard["values"].as_u64().unwrap() > 0, "{heard}");
    assert_eq!(rate("left.out")["measured_at"], "ear.heard");
    let told = refused(&daemon, "port hz sonar.out");
    assert!(told.contains("nobody reads sonar.out"), "{told}");
    assert!(
        refused(&daemon, "port hz sonar.aut").contains("voter `sonar` has no port `aut`; did you mean `sonar.out`?")
    );
}

#[test]
fn a_voter_is_told_of_as_what_it_is_and_offered_where_it_is_taken() {
    let daemon = sonars(&[], &[]);
    let info = ask(&daemon, "component info sonar");
    assert_eq!(info.code, Some(0), "{info:?}");
    for (name, value) in [("kind", "voter"), ("of", "left.out, middle.out, right.out"), ("require", "2")] {
        let shown = |line: &str| line.strip_prefix(name).is_some_and(|rest| rest.trim() == value);
        assert!(info.out.lines().any(shown), "{name}: {}", info.out);
    }
    assert_eq!(ask(&daemon, "component info sonar --format json").json()[0]["component"]["kind"], "voter");
    for verb in ["start", "stop", "reset"] {
        let told = refused(&daemon, &format!("component {verb} sonar"));
        assert_eq!(told, "`sonar` is a voter and no slot: `component info sonar` tells of it");
        let told = refused(&daemon, &format!("component {verb} nope"));
        assert_eq!(told, "there is no slot `nope`; possible here: `left`, `middle`, `right`");
        let told = refused(&daemon, &format!("component {verb} lefd"));
        assert_eq!(told, refused(&daemon, "component info lefd"));
    }
    let told = refused(&daemon, "component info nope");
    assert_eq!(told, "there is no slot `nope`; possible here: `left`, `middle`, `right`, `sonar`");
    assert!(refused(&daemon, "fault list --slot nope").ends_with("`right`, `sonar`"));
    assert_eq!(ask(&daemon, "fault list --slot sonar").code, Some(0));
    assert_eq!(ask(&daemon, "fault list --last 0").code, Some(2));
    assert_eq!(ask(&daemon, "fault follow --last 0 --count 0").code, Some(2));
}

#[test]
fn a_composite_is_no_slot_and_names_those_that_it_has() {
    let inside = application(&[slot("one", "Ticker", "")], &[]);
    let profiles = Profiles::new(&application(&[slot("ring", "Ring", "")], &[]));
    let export = "<export_ports><export_port><component_name>one</component_name><port_name>out</port_name>\
                  <port_type>data</port_type><export_port_name>ticks</export_port_name></export_port></export_ports>";
    let inside = inside.replace("</application_profile>", &format!("{export}</application_profile>"));
    let inside = inside.replace("application_profile", "composite_component_profile").replace(">test<", ">Ring<");
    profiles.write("Ring.xml", &inside);
    let daemon = Running::start(profiles.path(), &[]);
    let told = refused(&daemon, "component stop ring");
    assert_eq!(told, "`ring` is a composite and no slot; its slots are `ring.one`");
    assert_eq!(refused(&daemon, "fault list --slot ring"), told);
    assert!(refused(&daemon, "component info rinq").contains("did you mean `ring`?"));
    assert!(
        refused(&daemon, "port hz ring.out")
            .contains("composite `ring` has no port `out`; possible here: `ring.ticks`")
    );
}

#[test]
fn who_follows_ends_when_nobody_reads_though_nothing_comes() {
    let profiles = Profiles::new(&application(&[slot("ticker", "Ticker", ""), slot("mute", "Listener", "")], &[]));
    let daemon = Running::start(profiles.path(), &["--inject", "ticker:crash.segv@0.1"]);
    let _ = daemon.journal("fault", 1);
    let mut following = start(&daemon, "fault follow --last 1");
    let mut line = String::new();
    let mut reader = BufReader::new(following.stdout.take().unwrap());
    assert!(reader.read_line(&mut line).is_ok_and(|read| read > 0) && line.contains("crash.segv"), "{line}");
    drop(reader);
    let mut waiting = vec![following];
    // Nobody reads from the beginning, and nothing ever comes.
    for words in ["port echo mute.heard", "fault follow", "port hz mute.heard --window 3600"] {
        let mut child = verb(daemon.socket(), words).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        waiting.push(child);
    }
    for child in waiting {
        let ended = finish(child);
        assert_eq!((ended.code, ended.err.as_str()), (Some(0), ""));
    }
}

#[test]
fn who_follows_without_a_standard_output_says_so() {
    let profiles = Profiles::new(&application(&[slot("mute", "Listener", "")], &[]));
    let daemon = Running::start(profiles.path(), &[]);
    for words in ["fault follow", "port echo mute.heard"] {
        let mut shell = Command::new("sh");
        shell
            .arg("-c")
            .arg(format!("exec \"$0\" {words} --socket \"$1\" >&-"))
            .arg(daemon_binary())
            .arg(daemon.socket());
        let ended = shell.output().unwrap();
        let told = String::from_utf8_lossy(&ended.stderr).into_owned();
        assert_eq!(ended.status.code(), Some(1), "{told}");
        assert_eq!(told, "framework-daemon: cannot write the result: standard output is closed\n");
        // That is not the same as to throw it away.
        let mut child = verb(daemon.socket(), words).stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(200));
        assert!(child.try_wait().unwrap().is_none(), "{words}");
        child.kill().unwrap();
        child.wait().unwrap();
    }
}
