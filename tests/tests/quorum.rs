//! A voter whose members do not agree: its own rule answers, whoever depends on it stops, and returns when enough agree again.

use tempfile::TempDir;
use tests::asking::{ask, check, graph};
use tests::profiles::{Profiles, application, slot};
use tests::running::Running;
use tests::sonars::{SONARS, line, needs, of, robot, root, state, voter, with_brakes};

#[test]
fn who_depends_on_a_voter_stops_where_too_few_agree_and_returns_in_order() {
    let slots = [slot("reader", "Witness", ""), slot("follower", "Witness", ""), slot("idle", "Witness", "")];
    let scripts = ["7", "7x100 40x400 7", "7x100 90x400 7"];
    let profiles = robot(scripts, "", "><severity>stop</severity>", &slots, &[]);
    needs(&profiles, "reader", "sonar");
    needs(&profiles, "follower", "reader");
    let picture = graph(profiles.path(), "dot").out;
    assert!(picture.contains("voter by median, too few: stop"), "{picture}");
    let daemon = Running::start(profiles.path(), &[]);
    let held = daemon.journal("held", 2);
    let lost = of(&daemon, "fault", "sonar").remove(0);
    let words = ["symptom", "action", "outcome"].map(|name| lost[name].as_str().unwrap_or("-"));
    assert_eq!(words, ["vote", "stop", "stopped"], "{lost}");
    assert_eq!(lost["diagnosis"]["severity"], "stop");
    daemon.wait_for(
        "voter sonar: vote: sonar.out, field distance: 1 of 3 agree, 2 must; whoever depends on it is stopped",
    );
    for (line, slot, reason) in [(&held[0], "reader", "needs sonar"), (&held[1], "follower", "needs reader")] {
        assert_eq!((line["slot"].as_str(), line["reason"].as_str()), (Some(slot), Some(reason)));
        assert_eq!(line["root"], root(&lost));
    }
    let returned = daemon.journal("returned", 2);
    assert_eq!((returned[0]["slot"].as_str(), returned[1]["slot"].as_str()), (Some("reader"), Some("follower")));
    assert_eq!((of(&daemon, "fault", "sonar").len(), of(&daemon, "healed", "sonar").len()), (1, 1));
    assert!(daemon.entries("held").iter().all(|line| line["slot"] != "idle"));
    // Those who cannot vote at all are not waited for.
    for slot in ["left", "middle"] {
        assert_eq!(ask(&daemon, &format!("component stop {slot}")).code, Some(0));
    }
    assert_eq!(state(&daemon, "reader"), ("inactive".to_owned(), Some("needs sonar".to_owned())));
    daemon.until("that is told as well", || of(&daemon, "fault", "sonar").len() == 2);
    assert_eq!(
        (voter(&daemon)["severity"].as_str(), voter(&daemon)["falls_short"].as_bool()),
        (Some("stop"), Some(true))
    );
    assert!(ask(&daemon, "status").out.contains("TOO FEW AGREE"));
    assert_eq!(ask(&daemon, "component start left").code, Some(0));
    daemon.until("two agree again", || state(&daemon, "follower").0 == "active");
    assert_eq!(voter(&daemon)["falls_short"], false);
}

#[test]
fn a_voter_inside_a_composite_can_be_needed_and_a_reload_loses_nothing_of_it() {
    let scripts = ["7", "7x100 40x400 7", "7x100 90x400 7"];
    let profiles = robot(scripts, "", "><severity>stop</severity>", &[], &[]);
    let inside = std::fs::read_to_string(profiles.path().join("app.xml")).unwrap();
    let export = "<export_ports><export_port><component_name>sonar</component_name><port_name>out</port_name>\
                  <port_type>data</port_type><export_port_name>ranges</export_port_name></export_port></export_ports>";
    let inside = inside.replace("</application_profile>", &format!("{export}</application_profile>"));
    let inside = inside.replace("application_profile", "composite_component_profile").replace(">test<", ">Ring<");
    profiles.write("Ring.xml", &inside);
    let more = [slot("ring", "Ring", ""), slot("reader", "Witness", ""), slot("ear", "Ear", "")];
    profiles.write("app.xml", &application(&more, &["ring.ranges -> ear.heard"]));
    needs(&profiles, "reader", "ring.sonra");
    let checked = check(profiles.path());
    assert!(checked.out.contains("no voter \"sonra\" is in the composite \"ring\""), "{checked:?}");
    assert!(checked.out.contains("did you mean ring.sonar?"), "{checked:?}");
    profiles.replace("app.xml", "ring.sonra", "ring.sonar");
    let daemon = Running::start(profiles.path(), &[]);
    let held = daemon.journal("held", 1).remove(0);
    let lost = of(&daemon, "fault", "ring.sonar").remove(0);
    assert_eq!((held["slot"].as_str(), held["reason"].as_str()), (Some("reader"), Some("needs ring.sonar")));
    profiles.replace("app.xml", "</subcomponents>", &format!("{}</subcomponents>", slot("late", "Witness", "")));
    assert_eq!(ask(&daemon, "reload").code, Some(0));
    let is_over = || !of(&daemon, "healed", "ring.sonar").is_empty();
    daemon.until("it is held by the new plan, too", || daemon.entries("held").len() >= 2 || is_over());
    assert!(daemon.entries("held").iter().all(|line| line["root"] == root(&lost)), "{:?}", daemon.entries("held"));
    daemon.until("the reader works again", || state(&daemon, "reader").0 == "active");
    assert_eq!(of(&daemon, "fault", "ring.sonar").len(), 1);
}

#[test]
fn a_voter_without_a_severity_stops_nobody() {
    let slots = [slot("reader", "Witness", "")];
    let profiles = robot(["7", "7x60 40", "7x60 90"], "", ">", &slots, &[]);
    let mut daemon = Running::start(profiles.path(), &[]);
    daemon.until("too few agree", || !of(&daemon, "fault", "sonar").is_empty());
    assert_eq!(of(&daemon, "fault", "sonar")[0]["outcome"], "ignored");
    assert_eq!(state(&daemon, "reader").0, "active");
    daemon.stop();
    assert_eq!(daemon.entries("held").len(), 0);
}

#[test]
fn where_the_rule_is_the_emergency_stop_that_stays_until_enough_agree() {
    let place = TempDir::new().unwrap();
    let profiles = with_brakes(["7"; 3], &place);
    let daemon = Running::start(profiles.path(), &[]);
    daemon.until("the wheels turn", || line(&place, "wheels").last().is_some_and(|text| text == "drive"));
    for slot in ["left", "middle"] {
        assert_eq!(ask(&daemon, &format!("component stop {slot}")).code, Some(0));
    }
    daemon.until("three lines of the emergency stop", || daemon.entries("emergency").len() >= 3);
    let raised = daemon.entries("emergency").remove(0);
    let lost = of(&daemon, "fault", "sonar").remove(0);
    assert_eq!((raised["slot"].as_str(), raised["outputs"].as_u64()), (Some("sonar"), Some(2)), "{raised}");
    assert_eq!((&raised["root"], lost["action"].as_str()), (&lost["seq"], Some("emergency")));
    for name in ["wheels", "arm"] {
        let written = line(&place, name);
        let first = written.iter().position(|text| text == "stop").unwrap();
        assert!(first < written.iter().position(|text| text == "ease").unwrap(), "outputs first: {written:?}");
        assert_eq!(written.last().map(String::as_str), Some("stop"));
    }
    // Whoever looks sees to the sonars first; nothing else is started.
    let refused = ask(&daemon, "fault clear");
    assert_eq!(refused.code, Some(6), "{refused:?}");
    assert!(refused.err.contains("too few members of the voter `sonar` agree"), "{refused:?}");
    assert_eq!(ask(&daemon, "component start wheels").code, Some(7));
    assert_eq!(ask(&daemon, "component start left").out, "left: active\n");
    daemon.until("two agree again", || !of(&daemon, "healed", "sonar").is_empty());
    assert_eq!(line(&place, "wheels").last().map(String::as_str), Some("stop"), "an operator clears it");
    let cleared = ask(&daemon, "fault clear");
    assert!(cleared.out.starts_with("the emergency stop for vote of sonar"), "{cleared:?}");
    assert!(cleared.out.ends_with("is cleared\nwheels: active\narm: active\n"), "{cleared:?}");
    daemon.until("the wheels turn again", || line(&place, "wheels").last().is_some_and(|text| text == "drive"));
    assert_eq!(of(&daemon, "fault", "sonar").len(), 1);
}

#[test]
fn a_disagreement_is_found_in_a_members_callback_and_stops_the_robot_as_well() {
    let place = TempDir::new().unwrap();
    let profiles = with_brakes(["7", "7x60 40", "7x60 90"], &place);
    let daemon = Running::start(profiles.path(), &[]);
    daemon.until("three lines of the emergency stop", || daemon.entries("emergency").len() >= 3);
    assert_eq!(daemon.entries("emergency").remove(0)["slot"], "sonar");
    assert!(ask(&daemon, "status").out.starts_with("EMERGENCY STOP latched"));
    for name in ["wheels", "arm"] {
        daemon.until("the brakes hold", || line(&place, name).last().is_some_and(|text| text == "stop"));
    }
    assert_eq!(ask(&daemon, "fault clear").code, Some(6), "they never agree again");
}

#[test]
fn where_the_members_cannot_work_without_the_actuators_it_is_taken_back_and_raised_anew() {
    let place = TempDir::new().unwrap();
    let profiles = with_brakes(["7", "7x100 40x60 ...", "7x100 90x60 ..."], &place);
    for sonar in SONARS {
        needs(&profiles, sonar, "wheels");
    }
    let daemon = Running::start(profiles.path(), &[]);
    daemon.until("the emergency stop", || daemon.entries("emergency").len() >= 3);
    daemon.until("the sonars wait for the wheels", || state(&daemon, "left").1.as_deref() == Some("needs wheels"));
    let cleared = ask(&daemon, "fault clear");
    assert!(cleared.out.starts_with("the emergency stop for vote of sonar"), "{cleared:?}");
    assert!(cleared.out.ends_with("is cleared\nwheels: active\narm: active\n"), "{cleared:?}");
    let healed = of(&daemon, "healed", "sonar").remove(0);
    assert_eq!(healed["evidence"]["forgiven"], true, "the loss has its end in the journal: {healed}");
    daemon.wait_for("agree, 2 must, forgiven with the emergency stop");
    // The sonars begin anew, agree for a while, and then they do not.
    daemon.until("it is raised again", || of(&daemon, "fault", "sonar").len() >= 2);
}

/// A filter behind the voter, whose silence and errors are answered by a reset, and an ear at it.
fn filtered(crash: &str, age: &str, properties: &str) -> Profiles {
    let rules =
        ["stale", "validity"].map(|symptom| format!("<severity symptom=\"{symptom}\">reset</severity>")).concat();
    let filter = format!("<properties>{properties}</properties><fault_tolerance>{rules}</fault_tolerance>");
    let slots = [slot("filter", "Amplifier", &filter), slot("ear", "Ear", "")];
    let profiles = robot(["7"; 3], crash, ">", &slots, &["sonar.out -> filter.heard", "filter.said -> ear.heard"]);
    let checked =
        "<usage>input</usage><validity field=\"distance\"><max>9</max><on_invalid>pass</on_invalid></validity>";
    profiles.replace("Ear.xml", "<usage>input</usage>", &format!("{checked}{age}"));
    profiles
}

#[test]
fn what_lies_behind_a_voter_waits_for_the_root_beyond_it_where_too_few_agree() {
    let profiles = filtered("", "<max_age>100ms</max_age>", "");
    let faults = ["--inject", "middle:crash.segv@0.4", "--inject", "right:crash.segv@0.4"];
    let daemon = Running::start(profiles.path(), &faults);
    daemon.until("the filter is silent", || !of(&daemon, "fault", "filter").is_empty());
    let (silent, lost) = (of(&daemon, "fault", "filter").remove(0), of(&daemon, "fault", "sonar").remove(0));
    let roots = ["middle", "right"].map(|slot| of(&daemon, "fault", slot).remove(0));
    assert_eq!(
        (silent["symptom"].as_str(), silent["outcome"].as_str()),
        (Some("stale"), Some("consequence")),
        "{silent}"
    );
    let root = roots.iter().find(|root| root["slot"] == silent["diagnosis"]["left_to"]).expect("one of the two");
    assert_eq!(silent["diagnosis"]["consequence_of"], root["seq"]);
    assert!(roots.iter().any(|root| root["seq"] == lost["diagnosis"]["consequence_of"]), "{lost}");
    // They stay dead: what outlives the window is the filter's own.
    daemon
        .until("the filter is reset", || of(&daemon, "fault", "filter").iter().any(|fault| fault["action"] == "reset"));
}

#[test]
fn one_that_is_outvoted_or_dies_excuses_nobody_behind_the_voter() {
    // From then on the filter multiplies by nine by itself, a moment after the left one died, whom nobody misses.
    let broken = "<property name=\"after\">101</property><property name=\"then\">9</property>";
    let crash = "<fault_tolerance><severity symptom=\"crash\">reset</severity></fault_tolerance>";
    let profiles = filtered(crash, "", broken);
    let daemon = Running::start(profiles.path(), &["--inject", "left:crash.segv@0.35"]);
    daemon.until("the filter errs", || !of(&daemon, "fault", "filter").is_empty());
    let fault = of(&daemon, "fault", "filter").remove(0);
    assert_eq!((fault["symptom"].as_str(), fault["action"].as_str()), (Some("validity"), Some("reset")), "{fault}");
    assert!(fault["diagnosis"]["left_to"].is_null() && fault["diagnosis"]["consequence_of"].is_null(), "{fault}");
    daemon.until("left is reset", || !of(&daemon, "fault", "left").is_empty());
}

#[test]
fn what_silenced_a_member_long_before_it_is_missed_is_the_root_of_the_loss() {
    let scripts = ["7", "7x80 700", "7x80 700"];
    let profiles = robot(scripts, "", "><severity>stop</severity>", &[], &[]);
    let checked =
        "<usage>output</usage><validity field=\"distance\"><max>500</max><on_invalid>drop</on_invalid></validity>";
    profiles.replace("Wave.xml", "<usage>output</usage>", checked);
    let daemon = Running::start(profiles.path(), &[]);
    daemon.until("too few agree", || !of(&daemon, "fault", "sonar").is_empty());
    let lost = of(&daemon, "fault", "sonar").remove(0);
    let roots = ["middle", "right"].map(|slot| of(&daemon, "fault", slot).remove(0));
    assert!(roots.iter().all(|root| root["symptom"] == "validity"), "{roots:?}");
    assert!(roots.iter().any(|root| root["seq"] == lost["diagnosis"]["consequence_of"]), "{lost}");
}

#[test]
fn what_befalls_a_member_that_agrees_is_not_the_root_of_the_loss() {
    let ignore = "<fault_tolerance><severity symptom=\"error\">ignore</severity></fault_tolerance>";
    let profiles = robot(["7"; 3], ignore, "><severity>stop</severity>", &[], &[]);
    // It errs again and again, and agrees all the same.
    let errors: Vec<String> =
        (1..100).flat_map(|at| ["--inject".to_owned(), format!("right:error@{}", at as f64 / 10.0)]).collect();
    let daemon = Running::start(profiles.path(), &errors.iter().map(String::as_str).collect::<Vec<_>>());
    daemon.until("it errs", || !of(&daemon, "fault", "right").is_empty());
    for slot in ["left", "middle"] {
        assert_eq!(ask(&daemon, &format!("component stop {slot}")).code, Some(0));
    }
    daemon.until("too few agree", || !of(&daemon, "fault", "sonar").is_empty());
    let lost = of(&daemon, "fault", "sonar").remove(0);
    assert!(lost["diagnosis"]["consequence_of"].is_null(), "{lost}");
    assert!(of(&daemon, "fault", "right").iter().all(|fault| fault["symptom"] == "error"));
}

#[test]
fn a_monitor_watches_what_a_voter_hands_on() {
    let slots = [slot("ear", "Ear", "")];
    let profiles = robot(["7x60 400"; 3], "", ">", &slots, &["sonar.out -> ear.heard"]);
    let monitor =
        "<monitor component=\"sonar\" port=\"out\"><validity field=\"distance\"><max>300</max></validity></monitor>\n";
    profiles.replace("app.xml", "<voting", &format!("{monitor}<voting"));
    assert_eq!(check(profiles.path()).code, Some(0));
    let daemon = Running::start(profiles.path(), &[]);
    // Where they leap one may do so a moment later than the others, and be outvoted.
    let found = || daemon.entries("fault").into_iter().find(|fault| fault["symptom"] == "validity");
    daemon.until("the monitor finds it", || found().is_some());
    let fault = found().unwrap();
    assert_eq!((fault["outcome"].as_str(), &fault["evidence"]["value"]), (Some("ignored"), &serde_json::json!(400.0)));
    assert!(SONARS.contains(&fault["slot"].as_str().unwrap()), "the winner's: {fault}");
    daemon.wait_for_lines("distance 400", 5);
}
